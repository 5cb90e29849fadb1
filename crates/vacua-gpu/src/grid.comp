#version 460
#extension GL_GOOGLE_include_directive : require
// Where rays meet what is active, by `grid`: a walk over the distance map.
#include "shared.glsl"
#include "lattice.glsl"
#include "ray.glsl"
#include "tile.glsl"
#include "runs.glsl"
#include "walk.glsl"
#include "skip_grid.glsl"
#include "find.glsl"

void main() {
    find_pixel(own_pixel());
}
