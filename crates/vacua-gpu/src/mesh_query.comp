#version 460
#extension GL_GOOGLE_include_directive : require
// One ray a pixel through a mesh of multi-leaves, or of cells in a list, which are found by ray queries.
#extension GL_EXT_ray_query : require
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
#include "mesh_traced.glsl"

// Whether values are found with the cells.
const bool TOGETHER = false;

#include "mesh_ray.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 0, binding = 2) uniform accelerationStructureEXT scene;

uint first_wanted(uint wanted) {
    return wanted;
}

void find_all(Mesh mesh, Segment segment) {}

bool find(Mesh mesh, uint i, vec3 place, out Found at) {
    at.is_valid = false;
    at.value = 0.0;
    at.cell = Cell(0, NO_CELL, 0, false);
    rayQueryEXT query;
    rayQueryInitializeEXT(
        query, scene, gl_RayFlagsNoneEXT, 0xff, place, 0.0, EPSILON_DIRECTION, mesh.slack.x
    );
    while (rayQueryProceedEXT(query)) {
        uint shape = uint(rayQueryGetIntersectionPrimitiveIndexEXT(query, false));
        try_shape(mesh, place, shape, at.cell);
    }
    return at.cell.primitive != NO_CELL;
}

void main() {
    Mesh mesh = mesh_of(uvec2(push.planes));
    uvec2 own = gl_GlobalInvocationID.xy;
    make_pixel(mesh, own);
}
