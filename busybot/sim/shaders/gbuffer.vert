#version 450
// Transforms to the camera and hands the world's position and normal to the fragment shader.
// The uniform blocks are the simulator's interface; their layout is fixed.

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

layout(location = 0) out vec3 worldPosition;
layout(location = 1) out vec3 worldNormal;
layout(location = 2) out vec2 textureCoordinate;
layout(location = 3) out flat uvec4 segmentation;

void main() {
  vec4 world = objectTransformBuffer.modelMatrix * vec4(position, 1);
  worldPosition = world.xyz;
  worldNormal = mat3(objectTransformBuffer.modelMatrix) * normal;
  textureCoordinate = uv;
  segmentation = objectDataBuffer.segmentation;
  gl_Position = cameraBuffer.projectionMatrix * (cameraBuffer.viewMatrix * world);
}
