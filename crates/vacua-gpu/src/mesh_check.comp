#version 460
#extension GL_GOOGLE_include_directive : require
// Whether nodes and indices of a mesh stay within their sub-meshes, once when it is sent: shaders
// that follow addresses must not follow a damaged file's. A node an invocation, a sub-mesh a
// row. `skip` has a bit a node, set once that is somebody's child.
#include "shared.glsl"
#include "mesh.glsl"

layout(local_size_x = 256) in;

// Whether all of some indices are those of vertices.
bool are_vertices(Submesh part, uint first, uint count) {
    for (uint i = 0; i < count; ++i) {
        if (index_at(part, first + i) >= part.num_vertices) return false;
    }
    return true;
}

bool is_sound(Submesh part, uint node) {
    uint first = first_index_of(part, node);
    uint below = first_child_of(part, node);
    for (uint k = 0; k < 8; ++k) {
        Child child = child_at(part, node, k);
        if (child.is_inner) {
            if (below <= node || below >= part.num_nodes) return false;
            // A child of two nodes would be gone through twice, and what is below it many times.
            uint number = part.first_node + below;
            uint bit = 1u << (number & 31u);
            if ((atomicOr(push.skip.word[number >> 5], bit) & bit) != 0) return false;
            ++below;
        }
        uint words = leaf_indices(child.counts);
        if (first > part.num_indices || words > part.num_indices - first) return false;
        uint of_tets = 4 * (child.counts & 3u) + 5 * (child.counts >> 2 & 15u);
        if (!are_vertices(part, first, of_tets)) return false;
        for (uint i = 0; i < child.counts >> 6; ++i) {
            uint place = first + of_tets + 8 * i;
            uint corners = num_corners(other_at(part, place).kind);
            if (!are_vertices(part, place, corners)) return false;
        }
        first += words;
    }
    return true;
}

void main() {
    Mesh mesh = mesh_of(uvec2(push.planes));
    for (uint number = gl_WorkGroupID.y; number < mesh.num_submeshes; number += gl_NumWorkGroups.y) {
        Submesh part = mesh.submeshes.submesh[number];
        uint stride = gl_NumWorkGroups.x * 256;
        for (uint node = gl_GlobalInvocationID.x; node < part.num_nodes; node += stride) {
            if (!is_sound(part, node)) mesh.damage = 1;
        }
    }
}
