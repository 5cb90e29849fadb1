// One ray: seeks what is active, samples it, composites front to back.
//
// Samples are composited one by one in order; a sample without extinction multiplies by exactly 1
// and adds exactly 0, so that leaving it out changes no bit. Whether a ray ends is asked at the ends
// of blocks only, as the contract has it.
//
// The including stage says how empty space is skipped: `Walk` is what a ray keeps for that, made by
// `walk_of`, and `seek` moves k to the next sample that may be active, and `stop` to the end of those
// that follow it without a gap. `first_wanted` gives the block that is evaluated next.

// Samples that are fetched before the first of them is evaluated.
const uint BATCH = 4;

// The first block that any ray of the subgroup wants.
uint first_wanted(uint wanted) {
    return subgroupMin(wanted);
}

// Smallest cell between two, both included, along an axis, in units of the smallest of all.
float smallest(int axis, float p, float q) {
    uint cells = parameters.cells[axis];
    uint a = uint(min(p, q));
    uint b = uint(max(p, q));
    uint level = uint(findMSB(b - a + 1));
    uint minima = parameters.axis_offset[axis] + (cells + 1) + 4 * cells
        + level * (cells + 1) - ((1u << level) - 1);
    return min(push.planes.number[minima + a], push.planes.number[minima + b + 1 - (1u << level)]);
}

float length_sq(vec3 v) {
    precise float sum = fma(v.x, v.x, fma(v.y, v.y, v.z * v.z));
    return sum;
}

// Level of the dyadic block that holds sample k: twin of `vacua_render`'s partition.
uint level_of(Ray ray, vec3 rates, uint k) {
    float finest_sq = length_sq(rates);
    for (uint level = MAX_LEVEL; level > 0; --level) {
        uint first = k & ~((BLOCK << level) - 1);
        uint last = first + (BLOCK << level) - 1;
        vec3 p = cell_of(position(ray, float(first)));
        vec3 q = cell_of(position(ray, float(last)));
        vec3 sizes = vec3(smallest(0, p.x, q.x), smallest(1, p.y, q.y), smallest(2, p.z, q.z));
        float stride = float(1u << level);
        if (length_sq(rates / sizes) * stride * stride <= finest_sq) return level;
    }
    return 0;
}

// Marches one ray. Where the stage has rays march in step, all of a subgroup evaluate the same block
// of samples, the first that any of them needs, or wait: so their samples stay neighbours, and no ray
// walks while others sample.
void march(inout Pixel pixel, Ray ray) {
    float termination = parameters.box_hi.w;
    precise float optical_length = ray.dt * parameters.table_scale.z * 1.44269504;
    vec3 rates = vec3(0.0);
    if (RECTILINEAR) {
        rates = ray.step / vec3(
            parameters.anchor.w, parameters.anchor_x.w, parameters.anchor_y.w
        );
    }
    const uint NEVER = 0xffffffffu;
    uint k = ray.begin;
    Walk walk = walk_of(ray);
    // Samples from k to here are in one active macrocell; what follows in its last block is
    // evaluated too, so that no block is visited twice.
    uint stop = SKIPPING ? k : ray.end;
    uint last_block = k / BLOCK;
    while (true) {
        if (SKIPPING && k >= stop && k < ray.end) seek(ray, walk, k, stop);
        // Whether a ray ends is asked when it comes to another block.
        bool has_ended = !MAXIMUM && pixel.transmittance < termination && k / BLOCK != last_block;
        if (has_ended) k = ray.end;
        uint wanted = k < ray.end ? k / BLOCK : NEVER;
        uint block = first_wanted(wanted);
        if (block == NEVER) break;
        if (wanted == block) {
            last_block = block;
            if (RECTILINEAR) {
                // A whole block at a time, from its first sample at or after k.
                uint level = level_of(ray, rates, k);
                uint stride = 1u << level;
                uint block_end = (k & ~((BLOCK << level) - 1)) + (BLOCK << level);
                uint limit = min(block_end, ray.end);
                uint i = (k + stride - 1) & ~(stride - 1);
                for (; i < limit; i += stride) {
                    Sample s = fetch_at(position(ray, float(i)));
                    add(pixel, ray, float(i), optical_length * float(stride), s);
                    ++pixel.samples;
                }
                k = block_end;
                stop = max(stop, k);
            } else {
                uint first = block * BLOCK;
                uint limit = min(first + BLOCK, ray.end);
                pixel.samples += limit - k;
                for (uint i = first; i < limit; i += BATCH) {
                    if (i + BATCH <= k) continue;
                    Sample fetched[BATCH];
                    for (uint j = 0; j < BATCH; ++j) {
                        fetched[j] = fetch_at(position(ray, float(i + j)));
                    }
                    for (uint j = 0; j < BATCH; ++j) {
                        if (i + j < k || i + j >= limit) continue;
                        add(pixel, ray, float(i + j), optical_length, fetched[j]);
                    }
                }
                k = limit;
            }
        }
    }
}

// Makes a pixel, numbered by this device's own rows.
void make_pixel(uvec2 own) {
    uvec2 at = uvec2(own.x, global_row(own.y));
    if (at.x >= parameters.picture.x || at.y >= parameters.picture.y) return;
    Pixel pixel = empty_pixel();
    Ray ray = ray_of(at);
    march(pixel, ray);
    store(pixel, at, own.y, ray.dt, ray.t_start);
}
