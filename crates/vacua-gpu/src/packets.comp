#version 460
#extension GL_GOOGLE_include_directive : require
// Where rays meet what is active, by `mesh` over our own hierarchy, which any device can walk.
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#extension GL_KHR_shader_subgroup_vote : require
#include "shared.glsl"
#include "lattice.glsl"
#include "ray.glsl"
#include "subgroup.glsl"
#include "lanes.glsl"
#include "runs.glsl"
#include "walk.glsl"
#include "beam.glsl"
#include "find.glsl"
#include "skip_mesh.glsl"
#include "tree.glsl"
#include "packets.glsl"

void main() {
    uvec2 tile = tile_of_lanes(LANES);
    uint columns = (parameters.picture.x + tile.x - 1) / tile.x;
    uint number = (gl_WorkGroupID.x + 65535u * gl_WorkGroupID.y) * SUBGROUPS + gl_SubgroupID;
    uvec2 own = uvec2(number % columns, number / columns) * tile
        + pixel_of_lane(gl_SubgroupInvocationID);
    uvec2 at = uvec2(own.x, global_row(own.y));
    bool is_inside = at.x < parameters.picture.x && at.y < parameters.picture.y;
    Ray ray = ray_of(at);
    if (!is_inside) ray.end = 0;
    bool is_seen = ray.begin < ray.end;
    Runs runs = runs_of(ray, first_run(own));
    Walk walk = walk_of(ray, runs);
    if (subgroupAny(walk.sought != NOTHING)) {
        Packet packet = packet_of(ray, is_seen);
        do {
            for (uint kind = FRONT; kind <= BACK; ++kind) {
                bool seeks = walk.sought == kind;
                if (!subgroupAny(seeks)) continue;
                uint face = first_face(packet, ray, walk, seeks);
                if (seeks) take(ray, walk, runs, face);
            }
        } while (subgroupAny(walk.sought != NOTHING));
    }
    if (is_inside) close(runs);
}
