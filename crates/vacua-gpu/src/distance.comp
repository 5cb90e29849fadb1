#version 460
#extension GL_GOOGLE_include_directive : require
// One of three passes, along x, y and z, that turn the mask of active macrocells into Chebyshev
// distances to the nearest one, up to a reach: max norms separate by axis. The last pass writes what
// `lattice.glsl` reads: a macrocell beside active ones has no distance but says on which sides they are.
#include "shared.glsl"

layout(local_size_x = 256) in;

uint before(uint index) {
    return push.skip_before.word[index >> 2] >> (8 * (index & 3u)) & 255u;
}

// For a macrocell beside an active one, which of the boxes hold nothing active that reach from it to it
// or the next one upwards along each axis: bit x + 2 y + 4 z for the box that reaches to the next one
// along the axes of which the number is 1.
uint empty_boxes(uint index, uvec3 n) {
    uvec3 at = uvec3(index % n.x, index / n.x % n.y, index / (n.x * n.y));
    uint boxes = 255u;
    for (uint corner = 1; corner < 8; ++corner) {
        uvec3 apart = uvec3(corner & 1u, corner >> 1 & 1u, corner >> 2);
        if (any(greaterThanEqual(at + apart, n))) continue;
        if (before(index + apart.x + n.x * (apart.y + n.y * apart.z)) > 0) continue;
        for (uint box = corner; box < 8; ++box) {
            if ((box & corner) == corner) boxes &= ~(1u << box);
        }
    }
    return boxes;
}

void main() {
    uint word = gl_GlobalInvocationID.x + 65535u * 256u * gl_WorkGroupID.y;
    uvec3 n = parameters.macrocells.xyz;
    uint num = n.x * n.y * n.z;
    if (4 * word >= num) return;
    uint stride = push.pass == 0 ? 1 : push.pass == 1 ? n.x : n.x * n.y;
    uint along = n[push.pass];
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
        if (push.pass == 2 && best > 0) {
            uint boxes = best == 1 ? empty_boxes(index, n) : 255u;
            best = boxes < 128u ? boxes : 128u | best;
        }
        bytes |= best << (8 * i);
    }
    push.skip.word[word] = bytes;
}
