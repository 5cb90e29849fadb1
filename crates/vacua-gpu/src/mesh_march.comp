#version 460
#extension GL_GOOGLE_include_directive : require
// One ray a pixel through a packed mesh; the rays of a subgroup search together, unless told otherwise.
#include "shared.glsl"
#include "lattice.glsl"
#include "table.glsl"
#include "ray.glsl"
#include "walk.glsl"
#include "light.glsl"
#include "mesh.glsl"
#include "mesh_tets.glsl"
#include "mesh_others.glsl"
#include "mesh_locate.glsl"
#include "mesh_values.glsl"

// Whether the rays of a subgroup search together, or each on its own.
layout(constant_id = 35) const bool TOGETHER = true;
// Whether it must be known in which sub-mesh a cell is.
const bool NEEDS_PARTS = HAS_TETS || SHADED;

#include "mesh_search.glsl"
#include "mesh_ray.glsl"

vec3 place_of_lane(uint lane, uint i) {
    uint stride = VARYING ? subgroupShuffle(block_stride, lane) : 1;
    uint k = subgroupShuffle(block_first, lane) + i * stride;
    return place_at(subgroupShuffle(ray.start, lane), subgroupShuffle(ray.step, lane), float(k));
}

vec3 forward() {
    return ray.step;
}

vec3 sideways() {
    vec3 turn = parameters.direction_x.xyz;
    return turn == vec3(0.0) ? parameters.anchor_x.xyz : turn;
}

uint first_wanted(uint wanted) {
    return subgroupMin(wanted);
}

void find_all(Mesh mesh, Segment segment) {
    if (TOGETHER) search(mesh, segment);
}

bool find(Mesh mesh, uint i, vec3 place, out Found at) {
    at.is_valid = false;
    at.value = 0.0;
    if (!TOGETHER) return locate(mesh, place, at.cell);
    uint slot = found_slot(gl_SubgroupInvocationID, i);
    uint part = NEEDS_PARTS ? found_part[slot] : IS_OTHER;
    uint node = CELL_DATA && HAS_TETS ? found_node[slot] : 0;
    at.cell = Cell(part & ~IS_OTHER, found[slot], node, (part & IS_OTHER) != 0);
    if (HAS_OTHERS) {
        at.value = found_value[slot];
        at.is_valid = is_number(at.value);
    }
    return at.cell.primitive != NO_CELL;
}

void main() {
    Mesh mesh = mesh_of(uvec2(push.planes));
    // Tiles of subgroups lie one below the other.
    uint columns = tile_columns();
    uint rows = LANES / columns;
    uint lane = gl_SubgroupInvocationID;
    uvec2 own = uvec2(
        gl_WorkGroupID.x * columns + lane % columns,
        (gl_WorkGroupID.y * SUBGROUPS + gl_SubgroupID) * rows + lane / columns
    );
    make_pixel(mesh, own);
}
