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
#include "mesh_search.glsl"
#include "mesh_ray.glsl"

// Whether the rays of a subgroup search together, or each on its own.
layout(constant_id = 35) const bool TOGETHER = true;

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
    at.has_value = false;
    at.is_valid = false;
    at.value = 0.0;
    if (!TOGETHER) return locate(mesh, place, at.cell);
    uint slot = found_slot(gl_SubgroupInvocationID, i);
    uint part = found_part[slot];
    at.cell = Cell(
        part & PART_BITS, found[slot], CELL_DATA ? found_node[slot] : 0, (part & IS_OTHER) != 0
    );
    if (HAS_OTHERS && (part & HAS_VALUE) != 0) {
        at.has_value = true;
        at.is_valid = (part & IS_VALID) != 0;
        at.value = found_value[slot];
    }
    return at.cell.primitive != NO_CELL;
}

void main() {
    Mesh mesh = mesh_of(uvec2(push.planes));
    // Subgroups see tiles about as wide as high, one below the other.
    uint bits = uint(findMSB(LANES));
    uint columns = 1u << ((bits + 1) / 2);
    uint rows = LANES / columns;
    uint lane = gl_SubgroupInvocationID;
    uvec2 own = uvec2(
        gl_WorkGroupID.x * columns + lane % columns,
        (gl_WorkGroupID.y * SUBGROUPS + gl_SubgroupID) * rows + lane / columns
    );
    make_pixel(mesh, own);
}
