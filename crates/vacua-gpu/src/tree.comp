#version 460
#extension GL_GOOGLE_include_directive : require
// A level of the hierarchy over the faces of the boundary, from the one below.
#include "shared.glsl"
#include "tree.glsl"

layout(local_size_x = 64) in;

void main() {
    uint node = gl_GlobalInvocationID.x + 65535u * 64u * gl_WorkGroupID.y;
    uint height = push.pass;
    if (node >= num_at(height)) return;
    uint num = min(num_at(height - 1) - WIDTH * node, WIDTH);
    Bounds all = Bounds(uvec3(0xffffu), uvec3(0));
    for (uint i = 0; i < num; ++i) {
        Bounds child = bounds_at(height - 1, WIDTH * node + i);
        all.lo = min(all.lo, child.lo);
        all.hi = max(all.hi, child.hi);
    }
    uint first = first_word(height, node);
    uvec3 words = all.lo | all.hi << 16;
    for (int a = 0; a < 3; ++a) parameters.nodes.word[first + a] = words[a];
}
