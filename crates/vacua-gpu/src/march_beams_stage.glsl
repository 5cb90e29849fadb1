// A stage that marches by beams. What includes it says how many samples are fetched before the first of them is
// evaluated, `FETCHED_TOGETHER`, and may say that runs were found: `OVER_RUNS`.
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_vote : require
#include "shared.glsl"
#include "lattice.glsl"
#include "table.glsl"
#include "volume.glsl"
#include "ray.glsl"
#include "sample.glsl"
#include "light.glsl"

#include "subgroup.glsl"
#include "lanes.glsl"
#include "runs.glsl"
#include "table_shared.glsl"
#include "composite.glsl"
#include "add.glsl"
#include "beam.glsl"

// Samples that are fetched before the first of them is evaluated.
const uint BATCH = FETCHED_TOGETHER;

#include "march_beams.glsl"

void main() {
    make_tiles();
}
