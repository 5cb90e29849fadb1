#version 460
#extension GL_GOOGLE_include_directive : require
// Nothing is met.
#extension GL_EXT_ray_tracing : require
#include "hit.glsl"

layout(location = 0) rayPayloadInEXT Hit found;

void main() {
    found = Hit(NO_HIT, gl_RayTmaxEXT);
}
