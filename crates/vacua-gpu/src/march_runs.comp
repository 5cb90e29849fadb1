#version 460
#extension GL_GOOGLE_include_directive : require
// One ray a pixel, over the runs of samples that another shader found, each ray for itself.
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "shared.glsl"
#include "lattice.glsl"
#include "table.glsl"
#include "volume.glsl"
#include "ray.glsl"
#include "sample.glsl"
#include "light.glsl"
#include "lanes.glsl"
#include "tile.glsl"
#include "table_shared.glsl"
#include "composite.glsl"
#include "add.glsl"
#include "runs.glsl"
#include "skip_runs.glsl"
#include "march.glsl"

void main() {
    bring_table();
    make_pixel(own_pixel());
}
