#version 450
// Colour times light plus highlight and emission, and the id of what is seen; see gbuffer.vert.

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

layout(location = 0) in vec4 lightAndGloss;
layout(location = 1) in vec2 textureCoordinate;
layout(location = 2) in flat uint entity;

layout(location = 0) out vec4 outColor;
layout(location = 1) out uvec4 outSegmentation;

void main() {
  vec3 base = (materialBuffer.textureMask & 1) != 0
      ? texture(colorTexture, textureCoordinate * materialBuffer.textureTransforms[0].zw
                                  + materialBuffer.textureTransforms[0].xy).rgb
      : materialBuffer.baseColor.rgb;
  outColor = vec4(base * lightAndGloss.rgb + lightAndGloss.a + materialBuffer.emission.rgb, 1.0);
  outSegmentation = uvec4(0, entity, 0, 0);
}
