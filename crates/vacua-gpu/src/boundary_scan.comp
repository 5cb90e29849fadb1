#version 460
#extension GL_GOOGLE_include_directive : require
// Sums the groups' counts of faces, in one workgroup: each becomes the number of faces before its
// group, and the number of all is what the host asks for.
#include "shared.glsl"
#include "scan.glsl"

layout(local_size_x = 256) in;

const uint EACH = 8;

void main() {
    uint num = parameters.num_face_groups;
    uint before_chunk = 0;
    for (uint chunk = 0; chunk < num; chunk += 256 * EACH) {
        uint first = chunk + gl_LocalInvocationIndex * EACH;
        uint counts[EACH];
        uint sum = 0;
        for (uint i = 0; i < EACH; ++i) {
            counts[i] = first + i < num ? parameters.face_counts.word[first + i] : 0;
            sum += counts[i];
        }
        uint all;
        uint before = before_chunk + sum_before(sum, all);
        for (uint i = 0; i < EACH; ++i) {
            if (first + i < num) parameters.face_counts.word[first + i] = before;
            before += counts[i];
        }
        // More faces than can be numbered stay more.
        before_chunk += min(all, 0xffffffffu - before_chunk);
    }
    if (gl_LocalInvocationIndex == 0) push.counter.word[1] = before_chunk;
}
