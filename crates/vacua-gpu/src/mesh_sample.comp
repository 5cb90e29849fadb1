#version 460
#extension GL_GOOGLE_include_directive : require
// Values at a list of places, each place a block of its own: what tests compare with the CPU's.
#include "shared.glsl"
#include "mesh.glsl"
#include "mesh_tets.glsl"
#include "mesh_others.glsl"
#include "mesh_locate.glsl"
#include "mesh_values.glsl"
#include "mesh_places.glsl"
#include "mesh_search.glsl"

// Whether the lanes of a subgroup search together, or each on its own.
layout(constant_id = 35) const bool TOGETHER = true;

vec3 place;

vec3 place_of(uint i) {
    return place;
}

vec3 forward() {
    return vec3(0.0, 0.0, 1.0);
}

vec3 sideways() {
    return vec3(1.0, 0.0, 0.0);
}

void main() {
    Mesh mesh = mesh_of(uvec2(push.planes));
    uint index = (gl_WorkGroupID.x * SUBGROUPS + gl_SubgroupID) * LANES + gl_SubgroupInvocationID;
    bool is_there = index < parameters.picture.x;
    place = is_there ? push.clips.quad[index].xyz : vec3(0.0);
    Cell cell;
    bool is_found;
    if (TOGETHER) {
        search(mesh, Segment(place, place, 0, 0.0, is_there ? 1 : 0));
        uint slot = found_slot(gl_SubgroupInvocationID, 0);
        uint part = found_part[slot];
        cell = Cell(
            part & PART_BITS, found[slot], CELL_DATA ? found_node[slot] : 0, (part & IS_OTHER) != 0
        );
        is_found = cell.primitive != NO_CELL;
    } else {
        is_found = is_there && locate(mesh, place, cell);
    }
    if (!is_there) return;
    store_sample(mesh, index, place, is_found, cell);
}
