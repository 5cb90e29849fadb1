#version 460
#extension GL_GOOGLE_include_directive : require
// Boxes of the multi-leaves of a mesh, which its acceleration structure is built of: six numbers each,
// in `depth`. A node an invocation, a sub-mesh a row.
#include "shared.glsl"
#include "mesh.glsl"

layout(local_size_x = 256) in;

void main() {
    Mesh mesh = mesh_of(uvec2(push.planes));
    vec3 slack = mesh.slack.xyz;
    for (uint number = gl_WorkGroupID.y; number < mesh.num_submeshes; number += gl_NumWorkGroups.y) {
        Submesh part = mesh.submeshes.submesh[number];
        vec3 unit = float(CHILD_DIVISIONS) / part.sixteenths.xyz;
        uint stride = gl_NumWorkGroups.x * 256;
        for (uint node = gl_GlobalInvocationID.x; node < part.num_nodes; node += stride) {
            uint first = node * node_words();
            uvec3 words = uvec3(
                part.nodes.word[first],
                part.nodes.word[first + 1],
                part.nodes.word[first + 2]
            );
            vec3 lo = vec3(words.x & 0xffffu, words.x >> 16, words.y & 0xffffu);
            vec3 hi = vec3(words.y >> 16, words.z & 0xffffu, words.z >> 16);
            // A little wider than they are: past the rounding of places and of the device's own test.
            lo = fma(lo, unit, part.base.xyz) - 4.0 * slack;
            hi = fma(hi, unit, part.base.xyz) + 4.0 * slack;
            uint to = 6 * (part.first_node + node);
            for (int a = 0; a < 3; ++a) {
                push.depth.number[to + a] = lo[a];
                push.depth.number[to + 3 + a] = hi[a];
            }
        }
    }
}
