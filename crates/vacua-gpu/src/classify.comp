#version 460
#extension GL_GOOGLE_include_directive : require
// Which macrocells are active, in constant time each (paper A §4.2.1): a byte each, 0 for active
// ones and the reach of the distance map for others.
#include "shared.glsl"
#include "table.glsl"

layout(local_size_x = 256) in;

shared uint total;

void main() {
    if (gl_LocalInvocationIndex == 0) total = 0;
    barrier();
    uint word = gl_GlobalInvocationID.x + 65535u * 256u * gl_WorkGroupID.y;
    uvec3 n = parameters.macrocells.xyz;
    uint num = n.x * n.y * n.z;
    uint bytes = 0;
    uint found = 0;
    for (uint i = 0; i < 4; ++i) {
        uint index = 4 * word + i;
        uint nearest = parameters.picture.z;
        if (index < num) {
            vec2 range = push.ranges.pair[index];
            bool is_active;
            if (MAXIMUM) {
                is_active = parameters.table_scale.w < range.y;
            } else {
                is_active = range.x <= range.y
                    && push.next_active.word[table_bin(range.x)] <= table_bin(range.y);
            }
            if (is_active) {
                nearest = 0;
                ++found;
            }
        }
        bytes |= nearest << (8 * i);
    }
    if (4 * word < num) push.skip.word[word] = bytes;
    atomicAdd(total, found);
    barrier();
    if (gl_LocalInvocationIndex == 0 && total > 0) atomicAdd(push.counter.word[0], total);
}
