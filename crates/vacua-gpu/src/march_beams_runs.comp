#version 460
#extension GL_GOOGLE_include_directive : require
// One ray a pixel over a uniform grid, over the runs of samples that another shader found, where surfaces are not
// lit.
#define FETCHED_TOGETHER 2
#define OVER_RUNS
#include "march_beams_stage.glsl"
