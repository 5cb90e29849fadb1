// Prefix sums over a workgroup of 256.

shared uint sums[256];

// The sum over all invocations before this one, and over all. All of them must call it.
uint sum_before(uint own, out uint all) {
    uint lane = gl_LocalInvocationIndex;
    barrier();
    sums[lane] = own;
    barrier();
    for (uint apart = 1; apart < 256; apart *= 2) {
        uint below = lane >= apart ? sums[lane - apart] : 0;
        barrier();
        sums[lane] += below;
        barrier();
    }
    all = sums[255];
    return sums[lane] - own;
}
