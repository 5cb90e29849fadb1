#version 460
#extension GL_GOOGLE_include_directive : require
// The face that a ray meets first: its number, how far away it is, and whether it is met in front.
#extension GL_EXT_ray_tracing : require

layout(location = 0) rayPayloadInEXT uvec4 found;

void main() {
    bool is_front = gl_HitKindEXT == gl_HitKindFrontFacingTriangleEXT;
    found = uvec4(uint(gl_PrimitiveID), floatBitsToUint(gl_HitTEXT), is_front ? 1 : 0, 0);
}
