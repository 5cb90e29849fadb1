// Rays of a subgroup that look ahead together, and sample the same stretches of samples.
// Subgroups take tiles of the picture in turn, until none is left, and have the transfer table from one to
// the next.
//
// Samples are composited one by one in order; a sample without extinction multiplies by exactly 1
// and adds exactly 0, so that leaving it out changes no bit. Whether a ray ends is asked at the begin
// of blocks only, as the contract has it.
//
// The including stage says how many samples are fetched before the first of them is evaluated: `BATCH`. As a
// constant that pipelines are specialised by, with a loop whose count compilers do not know, it was 9.66
// instead of 6.34 ms on an H100 where surfaces are lit. And it says what is ahead: `Ahead` is what a subgroup
// keeps for that, made by `ahead_of`; `rounds_from` gives a bit for each of the next rounds that any of its
// rays wants samples of, and `stretches_from` for each stretch of a round. Both ask in ascending order.

// Samples that are sampled or left out together: a part of a block, so that what follows an active macrocell
// is not sampled far beyond it.
const uint STRETCH = 4;
// Samples of as many stretches as there are bits.
const uint ROUND = STRETCH * LOOKERS;

#ifdef OVER_RUNS
#include "ahead_runs.glsl"
#else
#include "ahead_map.glsl"
#endif

// Adds the samples of a batch that are among the ray's `num`.
void add_batch(inout Pixel pixel, Ray ray, uint first, uint num, float optical_length) {
    uint from = first - ray.begin;
    // Numbers below the first wrap around.
    if (from + (BATCH - 1) >= num + (BATCH - 1)) return;
    float k = float(first);
    Sample fetched[BATCH];
    for (uint j = 0; j < BATCH; ++j) fetched[j] = fetch_at(position(ray, k + float(j)));
    for (uint j = 0; j < BATCH; ++j) {
        if (from + j >= num) continue;
        add(pixel, ray, k + float(j), optical_length, fetched[j]);
    }
    pixel.samples += uint(min(int(from + BATCH), int(num)) - max(int(from), 0));
}

// Marches the rays of a subgroup: all of it comes here, and has a ray or none.
void march(inout Pixel pixel, Ray ray, uvec2 own) {
    float termination = parameters.box_hi.w;
    precise float optical_length = ray.dt * parameters.table_scale.z * 1.44269504;
    // Samples of the ray; none once it has ended.
    uint num = ray.begin < ray.end ? ray.end - ray.begin : 0;
    bool is_seen = num > 0;
    uint window = subgroupMin(is_seen ? ray.window : 0xffffffffu);
    uint behind = is_seen ? (ray.window - window) * ALIGNMENT : 0;
    uint begin = subgroupMin(is_seen ? ray.begin + behind : 0xffffffffu);
    uint end = subgroupMax(is_seen ? ray.end + behind : 0);
    if (begin >= end) return;
    if (!SKIPPING) {
        for (uint block = begin & ~(BLOCK - 1); block < end; block += BLOCK) {
            if (!MAXIMUM && pixel.transmittance < termination) num = 0;
            if (subgroupAll(num == 0)) return;
            for (uint i = 0; i < BLOCK; i += BATCH) {
                add_batch(pixel, ray, block + i - behind, num, optical_length);
            }
        }
        return;
    }
    Ahead ahead = ahead_of(ray, is_seen, behind, begin, end, own);
    for (uint far = begin & ~(ROUND - 1); far < end; far += ROUND * LOOKERS) {
        uint rounds = rounds_from(ahead, far, num == 0);
        while (rounds != 0) {
            uint base = far + ROUND * uint(findLSB(rounds));
            rounds &= rounds - 1;
            uint wanted = stretches_from(ahead, base, num == 0);
            while (wanted != 0) {
                // A count that compilers know: without it 9.20 instead of 6.34 ms on an H100.
                const uint IN_BLOCK = BLOCK / STRETCH;
                uint place = uint(findLSB(wanted)) & ~(IN_BLOCK - 1);
                uint block = wanted >> place;
                wanted &= ~(((1u << IN_BLOCK) - 1) << place);
                if (!MAXIMUM && pixel.transmittance < termination) num = 0;
                for (uint i = 0; i < IN_BLOCK; ++i) {
                    if ((block >> i & 1u) == 0) continue;
                    for (uint j = 0; j < STRETCH; j += BATCH) {
                        uint first = base + STRETCH * (place + i) + j - behind;
                        add_batch(pixel, ray, first, num, optical_length);
                    }
                }
            }
            if (subgroupAll(num == 0)) return;
        }
    }
}

// Makes tiles of the picture until none is left.
void make_tiles() {
    bring_table();
    // Rows of this device's own, with those of a last band that it may not have.
    uint bands = (parameters.picture.y + 15u) / 16u;
    uint share = parameters.picture.w >> 16;
    uint rows = (bands + share - 1) / share * 16u;
    uvec2 tile = tile_of_lanes(LANES);
    uint columns = (parameters.picture.x + tile.x - 1) / tile.x;
    uint num = columns * ((rows + tile.y - 1) / tile.y);
    while (true) {
        uint number = 0;
        if (subgroupElect()) number = atomicAdd(push.counter.word[1], 1u);
        number = subgroupBroadcastFirst(number);
        if (number >= num) break;
        uvec2 own = uvec2(number % columns, number / columns) * tile
            + pixel_of_lane(gl_SubgroupInvocationID);
        uvec2 at = uvec2(own.x, global_row(own.y));
        bool is_inside = at.x < parameters.picture.x && at.y < parameters.picture.y;
        Pixel pixel = empty_pixel();
        Ray ray = ray_of(at);
        if (!is_inside) ray.end = 0;
        march(pixel, ray, own);
        if (is_inside) store(pixel, at, own.y, ray.dt, ray.t_start);
    }
}
