#version 460
#extension GL_GOOGLE_include_directive : require
// The nearest face, or the box that begins nearest.
#extension GL_EXT_ray_tracing : require
#include "hit.glsl"

layout(location = 0) rayPayloadInEXT Hit found;

void main() {
    found = Hit(uint(gl_PrimitiveID), gl_HitTEXT);
}
