#version 450
// One pass, no shadow maps: a key light, a fill light and a sky over a ground, a soft highlight, and darkening where a
// side meets the board. Everything is evaluated in the board frame (z towards the camera).

layout(set = 0, binding = 0) uniform CameraBuffer {
  mat4 viewMatrix;
  mat4 projectionMatrix;
  mat4 viewMatrixInverse;
  mat4 projectionMatrixInverse;
  float width;
  float height;
} cameraBuffer;

layout(set = 1, binding = 0) uniform ObjectTransformBuffer {
  mat4 modelMatrix;
} objectTransformBuffer;

layout(set = 1, binding = 1) uniform ObjectDataBuffer {
  uvec4 segmentation;
  float transparency;
  int shadeFlat;
} objectDataBuffer;

layout(set = 2, binding = 0) uniform MaterialBuffer {
  vec4 emission;
  vec4 baseColor;
  float fresnel;
  float roughness;
  float metallic;
  float transmission;
  float ior;
  float transmissionRoughness;
  int textureMask;
  int padding1;
  vec4 textureTransforms[6];
} materialBuffer;

layout(set = 2, binding = 1) uniform sampler2D colorTexture;
layout(set = 2, binding = 2) uniform sampler2D roughnessTexture;
layout(set = 2, binding = 3) uniform sampler2D normalTexture;
layout(set = 2, binding = 4) uniform sampler2D metallicTexture;
layout(set = 2, binding = 5) uniform sampler2D emissionTexture;

struct PointLight { vec4 position; vec4 emission; };
struct DirectionalLight { vec4 direction; vec4 emission; };
struct SpotLight { vec4 position; vec4 direction; vec4 emission; };

layout(set = 3, binding = 0) uniform SceneBuffer {
  vec4 ambientLight;
  DirectionalLight directionalLights[3];
  SpotLight spotLights[10];
  PointLight pointLights[10];
  SpotLight texturedLights[1];
} sceneBuffer;

layout(location = 0) in vec3 worldPosition;
layout(location = 1) in vec3 worldNormal;
layout(location = 2) in vec2 textureCoordinate;
layout(location = 3) in flat uvec4 segmentation;

layout(location = 0) out vec4 outColor;
layout(location = 1) out uvec4 outSegmentation;

const vec3 KEY_DIRECTION = vec3(-0.455, 0.542, 0.706);
const vec3 KEY_COLOR = vec3(0.62, 0.60, 0.56);
const vec3 FILL_DIRECTION = vec3(0.762, -0.318, 0.564);
const vec3 FILL_COLOR = vec3(0.14, 0.16, 0.19);
const vec3 SKY = vec3(0.44, 0.45, 0.47);
const vec3 GROUND = vec3(0.22, 0.20, 0.19);
const float CONTACT_HEIGHT = 0.05;
const float BODY_HEIGHT = 0.002;

vec3 lighting(vec3 n) {
  return mix(GROUND, SKY, 0.5 + 0.5 * n.z)
      + KEY_COLOR * max(dot(n, KEY_DIRECTION), 0.0)
      + FILL_COLOR * max(dot(n, FILL_DIRECTION), 0.0);
}

void main() {
  vec3 base = (materialBuffer.textureMask & 1) != 0
      ? texture(colorTexture, textureCoordinate * materialBuffer.textureTransforms[0].zw
                                  + materialBuffer.textureTransforms[0].xy).rgb
      : materialBuffer.baseColor.rgb;
  vec3 color;
  if (worldPosition.z < BODY_HEIGHT) {
    // board and table, most of the picture: matt, and their normals are clean
    color = base * lighting(worldNormal);
  } else {
    vec3 eye = normalize(cameraBuffer.viewMatrixInverse[3].xyz - worldPosition);
    // meshes come with normals of either sign and sometimes with none
    vec3 n = dot(worldNormal, worldNormal) > 1e-12 ? normalize(worldNormal) : eye;
    n = dot(n, eye) < 0.0 ? -n : n;
    float contact = mix(1.0, 0.72 + 0.28 * smoothstep(0.0, CONTACT_HEIGHT, worldPosition.z), 1.0 - abs(n.z));
    float shine = max(dot(n, normalize(KEY_DIRECTION + eye)), 0.0);
    shine *= shine; shine *= shine; shine *= shine; shine *= shine; shine *= shine;
    float rim = 1.0 - dot(n, eye);
    color = base * lighting(n) * contact + materialBuffer.emission.rgb
        + vec3(0.22 * (1.0 - 0.6 * materialBuffer.roughness) * shine + 0.16 * rim * rim);
  }
  outColor = vec4(clamp(color, 0.0, 1.0), 1.0);
  outSegmentation = segmentation;
}
