#version 460
#extension GL_GOOGLE_include_directive : require
// One of three passes, along x, y and z, that turn the mask of active macrocells into Chebyshev
// distances to the nearest one, up to a reach: max norms separate by axis.
#include "shared.glsl"

layout(local_size_x = 256) in;

uint before(uint index) {
    return push.skip_before.word[index >> 2] >> (8 * (index & 3u)) & 255u;
}

void main() {
    uint word = gl_GlobalInvocationID.x + 65535u * 256u * gl_WorkGroupID.y;
    uvec3 n = parameters.macrocells.xyz;
    uint num = n.x * n.y * n.z;
    if (4 * word >= num) return;
    uint stride = push.axis == 0 ? 1 : push.axis == 1 ? n.x : n.x * n.y;
    uint along = n[push.axis];
    uint reach = parameters.picture.z;
    uint bytes = 0;
    for (uint i = 0; i < 4; ++i) {
        uint index = 4 * word + i;
        if (index >= num) break;
        uint place = index / stride % along;
        uint best = before(index);
        for (uint apart = 1; apart < best && apart < reach; ++apart) {
            if (place >= apart) best = min(best, max(apart, before(index - apart * stride)));
            if (place + apart < along) {
                best = min(best, max(apart, before(index + apart * stride)));
            }
        }
        bytes |= best << (8 * i);
    }
    push.skip.word[word] = bytes;
}
