#version 460
#extension GL_GOOGLE_include_directive : require
// Boxes of the multi-leaves of a mesh, or of the cells of a plain list, which its acceleration structure
// is built of: six numbers each, in `depth`. A box an invocation, a sub-mesh a row.
#include "shared.glsl"
#include "mesh.glsl"

layout(local_size_x = 256) in;

void box_of_node(Submesh part, uint node, out vec3 lo, out vec3 hi) {
    vec3 unit = float(CHILD_DIVISIONS) / part.sixteenths.xyz;
    uint first = node * node_words();
    uvec3 words = uvec3(
        part.nodes.word[first],
        part.nodes.word[first + 1],
        part.nodes.word[first + 2]
    );
    lo = fma(vec3(words.x & 0xffffu, words.x >> 16, words.y & 0xffffu), unit, part.base.xyz);
    hi = fma(vec3(words.y >> 16, words.z & 0xffffu, words.z >> 16), unit, part.base.xyz);
}

void box_of_cell(Submesh part, uint cell, out vec3 lo, out vec3 hi) {
    uvec2 found = plain_cell(part, cell);
    lo = vec3(LARGEST);
    hi = vec3(-LARGEST);
    for (uint k = 0; k < num_corners(found.x); ++k) {
        vec3 corner = vertex_at(part, part.indices.word[found.y + k]);
        lo = min(lo, corner);
        hi = max(hi, corner);
    }
}

void main() {
    Mesh mesh = mesh_of(uvec2(push.planes));
    vec3 slack = mesh.slack.xyz;
    for (uint number = gl_WorkGroupID.y; number < mesh.num_submeshes; number += gl_NumWorkGroups.y) {
        Submesh part = mesh.submeshes.submesh[number];
        uint stride = gl_NumWorkGroups.x * 256;
        for (uint node = gl_GlobalInvocationID.x; node < part.num_nodes; node += stride) {
            vec3 lo;
            vec3 hi;
            if (IS_PLAIN) box_of_cell(part, node, lo, hi);
            else box_of_node(part, node, lo, hi);
            // A little wider than they are: past the rounding of places and of the device's own test.
            lo -= 4.0 * slack;
            hi += 4.0 * slack;
            uint to = 6 * (part.first_node + node);
            for (int a = 0; a < 3; ++a) {
                push.depth.number[to + a] = lo[a];
                push.depth.number[to + 3 + a] = hi[a];
            }
        }
    }
}
