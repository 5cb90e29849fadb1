// Which pixel an invocation of a compute shader makes.

layout(local_size_x = 256) in;

// The pixel in this device's own rows: subgroups of 32 see 8 × 4 pixels.
uvec2 own_pixel() {
    uint lane = gl_LocalInvocationIndex & 31u;
    uint group = gl_LocalInvocationIndex >> 5;
    return gl_WorkGroupID.xy * 16u
        + uvec2((group & 1u) * 8u, (group >> 1) * 4u) + pixel_of_lane(lane);
}
