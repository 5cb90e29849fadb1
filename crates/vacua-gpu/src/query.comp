#version 460
#extension GL_GOOGLE_include_directive : require
// Where rays meet what is active, by `mesh`, where compute shaders may ask acceleration structures
// themselves.
#extension GL_EXT_ray_query : require
#include "shared.glsl"
#include "lattice.glsl"
#include "ray.glsl"
#include "lanes.glsl"
#include "tile.glsl"
#include "runs.glsl"
#include "hit.glsl"
#include "walk.glsl"
#include "find.glsl"
#include "skip_mesh.glsl"
#include "trace_mesh.glsl"

layout(set = 0, binding = 2) uniform accelerationStructureEXT scene;

Hit first_hit(vec3 origin, float t_min, vec3 direction, float t_max, bool from_inside) {
    uint flags = gl_RayFlagsOpaqueEXT
        | (from_inside ? gl_RayFlagsCullFrontFacingTrianglesEXT : gl_RayFlagsCullBackFacingTrianglesEXT);
    rayQueryEXT query;
    rayQueryInitializeEXT(query, scene, flags, 0xff, origin, t_min, direction, t_max);
    while (rayQueryProceedEXT(query)) {}
    if (rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionTriangleEXT) {
        return Hit(NO_HIT, t_max);
    }
    return Hit(
        uint(rayQueryGetIntersectionPrimitiveIndexEXT(query, true)),
        rayQueryGetIntersectionTEXT(query, true)
    );
}

void main() {
    find_pixel(own_pixel());
}
