#version 460
// All cells have been met: what was found stays.
#extension GL_EXT_ray_tracing : require

layout(location = 0) rayPayloadInEXT uvec4 found;

void main() {}
