// Runs of samples that may be active, of methods that trace rays: found by one shader, and read by the
// one that samples, in step and from shared memory, as compute shaders can. All methods sample with the
// same code compiled for the same stage; compiled into a ray generation shader, NVIDIA's compiler made
// other last bits of it.
//
// `grid` walks and samples in one: a walk of its own took as long as within (2.2 ms of 4.0 at 1024³ and
// K = 4 on an H100), and its runs in whole blocks cost 8 % more samples.
//
// Runs are in whole blocks. A workgroup's rays have their first runs one after the other, then their
// second ones, and so on; a run is its first block and the one after its last, counted from the ray's
// first block, 16 bits each, and nothing if it is 0.

// Runs that a ray may have; what follows is one with the last.
const uint MAX_RUNS = 8;
// The end of a run that reaches to the end of the ray.
const uint OPEN_END = 0xffffu;
// Words from a ray's run to its next one.
const uint RUN_STRIDE = 256;

// Whether runs were looked for; where nothing is active there are none, and no ray is traced.
bool has_runs() {
    return parameters.num_shapes != 0;
}

// Where the first run of a ray lies, by its pixel in this device's own rows: rays are numbered as
// `own_pixel` has them.
uint first_run(uvec2 own) {
    uvec2 group = own / 16u;
    uvec2 local = own % 16u;
    uint columns = (parameters.picture.x + 15u) / 16u;
    uint subgroup = local.x >> 3 | local.y >> 2 << 1;
    return (group.y * columns + group.x) * (RUN_STRIDE * MAX_RUNS) + subgroup * 32u
        + lane_of_pixel(local);
}
