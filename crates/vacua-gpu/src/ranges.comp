#version 460
#extension GL_GOOGLE_include_directive : require
// Ranges of macrocells (paper A §4.1.1): one workgroup a macrocell, K + 1 points a side.
#include "shared.glsl"
#include "lattice.glsl"
#include "volume.glsl"

layout(local_size_x = 64) in;

shared vec2 partial[64];

vec2 with(vec2 range, float texel) {
    if (CHECK_FINITE && !is_finite(texel)) return range;
    float value = value_of(texel);
    return vec2(min(range.x, value), max(range.y, value));
}

void main() {
    uint index = gl_WorkGroupID.x + 65535u * gl_WorkGroupID.y;
    uvec3 n = parameters.macrocells.xyz;
    if (index >= n.x * n.y * n.z) return;
    uvec3 at = uvec3(index % n.x, index / n.x % n.y, index / (n.x * n.y));
    uint side = parameters.macrocells.w;
    uvec3 from = at * side;
    uvec3 size = min(from + side, parameters.cells.xyz) - from;
    vec2 range = vec2(uintBitsToFloat(0x7f800000u), uintBitsToFloat(0xff800000u));
    // For points: every second cell along x and y and the last one, with its four corners, in one
    // layer more than there are cells.
    uvec3 items = CELL_DATA ? size : uvec3(size.xy / 2u + 1u, size.z + 1u);
    uint count = items.x * items.y * items.z;
    uint seen = 0;
    for (uint i = gl_LocalInvocationIndex; i < count; i += 64) {
        uvec3 item = uvec3(i % items.x, i / items.x % items.y, i / (items.x * items.y));
        if (CELL_DATA) {
            range = with(range, fetch(vec3(from + item)));
            continue;
        }
        uvec2 cell = from.xy + min(2u * item.xy, size.xy - 1u);
        float layer = float(from.z + item.z);
        int slab = slab_of(float(min(from.z + item.z, parameters.cells.z - 1u)));
        vec4 corners = gather(slab, vec2(cell + 1u), layer);
        range = with(with(with(with(range, corners.x), corners.y), corners.z), corners.w);
    }
    if (BLANKED) {
        uint cells = size.x * size.y * size.z;
        for (uint i = gl_LocalInvocationIndex; i < cells; i += 64) {
            uvec3 cell = from + uvec3(i % size.x, i / size.x % size.y, i / (size.x * size.y));
            if (!is_blanked(vec3(cell))) seen = 1;
        }
    }
    partial[gl_LocalInvocationIndex] = range;
    barrier();
    for (uint half_size = 32; half_size > 0; half_size /= 2) {
        if (gl_LocalInvocationIndex < half_size) {
            vec2 a = partial[gl_LocalInvocationIndex];
            vec2 b = partial[gl_LocalInvocationIndex + half_size];
            partial[gl_LocalInvocationIndex] = vec2(min(a.x, b.x), max(a.y, b.y));
        }
        barrier();
    }
    range = partial[0];
    if (BLANKED) {
        barrier();
        partial[gl_LocalInvocationIndex] = vec2(float(seen));
        barrier();
        for (uint half_size = 32; half_size > 0; half_size /= 2) {
            if (gl_LocalInvocationIndex < half_size) {
                partial[gl_LocalInvocationIndex] = max(
                    partial[gl_LocalInvocationIndex],
                    partial[gl_LocalInvocationIndex + half_size]
                );
            }
            barrier();
        }
        if (partial[0].x == 0.0) {
            range = vec2(uintBitsToFloat(0x7f800000u), uintBitsToFloat(0xff800000u));
        }
    }
    if (gl_LocalInvocationIndex == 0) push.ranges.pair[index] = range;
}
