#version 460
#extension GL_GOOGLE_include_directive : require
// One ray a pixel over a uniform grid, by `none` and by `grid`, where surfaces are not lit.
#define FETCHED_TOGETHER 2
#include "march_beams_stage.glsl"
