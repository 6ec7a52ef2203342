#version 450
// Light is evaluated per vertex: a key light, a fill light and a sky over a ground, a soft highlight and rim, and
// darkening where a side meets the board. Board and table, most of the picture, then cost one texture look-up a pixel.
// Everything is in the board frame (z towards the camera). The uniform blocks are the simulator's interface.

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

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec3 tangent;
layout(location = 4) in vec3 bitangent;

layout(location = 0) out vec4 lightAndGloss;
layout(location = 1) out vec2 textureCoordinate;
layout(location = 2) out flat uint entity;

const vec3 KEY_DIRECTION = vec3(-0.455, 0.542, 0.706);
const vec3 KEY_COLOR = vec3(0.62, 0.60, 0.56);
const vec3 FILL_DIRECTION = vec3(0.762, -0.318, 0.564);
const vec3 FILL_COLOR = vec3(0.14, 0.16, 0.19);
const vec3 SKY = vec3(0.44, 0.45, 0.47);
const vec3 GROUND = vec3(0.22, 0.20, 0.19);
const float CONTACT_HEIGHT = 0.05;
const float BODY_HEIGHT = 0.002;

void main() {
  vec4 world = objectTransformBuffer.modelMatrix * vec4(position, 1);
  gl_Position = cameraBuffer.projectionMatrix * (cameraBuffer.viewMatrix * world);
  textureCoordinate = uv;
  entity = objectDataBuffer.segmentation.y;

  vec3 eye = normalize(cameraBuffer.viewMatrixInverse[3].xyz - world.xyz);
  vec3 n = mat3(objectTransformBuffer.modelMatrix) * normal;
  // meshes come with normals of either sign and sometimes with none
  n = dot(n, n) > 1e-12 ? normalize(n) : eye;
  n = dot(n, eye) < 0.0 ? -n : n;
  vec3 light = mix(GROUND, SKY, 0.5 + 0.5 * n.z)
      + KEY_COLOR * max(dot(n, KEY_DIRECTION), 0.0)
      + FILL_COLOR * max(dot(n, FILL_DIRECTION), 0.0);
  float gloss = 0.0;
  if (world.z > BODY_HEIGHT) {
    float rim = 1.0 - dot(n, eye);
    gloss = 0.2 * pow(max(dot(n, normalize(KEY_DIRECTION + eye)), 0.0), 24.0) + 0.16 * rim * rim;
  }
  float side = 1.0 - abs(n.z);
  lightAndGloss = vec4(light * mix(1.0, 0.72 + 0.28 * smoothstep(0.0, CONTACT_HEIGHT, world.z), side), gloss);
}
