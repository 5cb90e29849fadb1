#version 460
#extension GL_GOOGLE_include_directive : require
// Faces of the boundary in each group of lattice points.
#include "shared.glsl"
#include "lattice.glsl"
#include "boundary.glsl"

shared uint total;

void main() {
    if (group_number() >= parameters.num_face_groups) return;
    if (gl_LocalInvocationIndex == 0) total = 0;
    barrier();
    uint found = 0;
    uvec3 begin = brick_begin();
    for (uint i = 0; i < POINTS_EACH; ++i) found += bitCount(faces_at(point_of(begin, i)) & 7u);
    if (found > 0) atomicAdd(total, found);
    barrier();
    if (gl_LocalInvocationIndex == 0) parameters.face_counts.word[group_number()] = total;
}
