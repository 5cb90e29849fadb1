#version 460
#extension GL_GOOGLE_include_directive : require
// One ray a pixel over a uniform grid, by `none` and by `grid`, where surfaces are lit.
#define FETCHED_TOGETHER 4
#include "march_beams_stage.glsl"
