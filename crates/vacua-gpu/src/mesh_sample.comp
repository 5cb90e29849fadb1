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

// Whether the lanes of a subgroup search together, or each on its own.
layout(constant_id = 35) const bool TOGETHER = true;
// Whether it must be known in which sub-mesh a cell is.
const bool NEEDS_PARTS = true;

#include "mesh_search.glsl"

vec3 place;

vec3 place_of(uint i) {
    return place;
}

vec3 place_of_lane(uint lane, uint i) {
    return subgroupShuffle(place, lane);
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
    if (!TOGETHER) {
        Cell cell;
        bool is_found = is_there && locate(mesh, place, cell);
        if (is_there) store_sample(mesh, index, place, is_found, cell);
        return;
    }
    search(mesh, Segment(place, place, 0, 0.0, is_there ? 1 : 0));
    uint slot = found_slot(gl_SubgroupInvocationID, 0);
    uint bits = found_part[slot];
    uint node = CELL_DATA && HAS_TETS ? found_node[slot] : 0;
    Cell cell = Cell(bits & ~IS_OTHER, found[slot], node, (bits & IS_OTHER) != 0);
    bool is_found = cell.primitive != NO_CELL;
    if (!is_there) return;
    if (is_found && HAS_OTHERS && cell.is_other) {
        float value = found_value[slot];
        store_value(index, is_found, cell, is_number(value), value);
    } else {
        store_sample(mesh, index, place, is_found, cell);
    }
}
