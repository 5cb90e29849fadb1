// What is ahead of a subgroup's rays, by the runs that another shader found for each.

// The run of a ray that ends behind all that was asked for, in numbers of samples that the subgroup's rays
// have in common, and where the next one lies.
struct Ahead {
    uint from;
    uint to;
    uint place;
    // Runs that may follow.
    uint left;
    // The number of the ray's first block, and of its end.
    uint before;
    uint end;
};

const uint NO_RUN = 0xffffffffu;

void next_run(inout Ahead ahead) {
    uint run = ahead.left > 0 ? push.runs.word[ahead.place] : 0;
    ahead.place += RUN_STRIDE;
    ahead.left -= min(ahead.left, 1);
    uint end = run >> 16;
    ahead.from = run == 0 ? NO_RUN : (ahead.before + (run & 0xffffu)) * BLOCK;
    ahead.to = run == 0 ? NO_RUN : end == OPEN_END ? ahead.end : (ahead.before + end) * BLOCK;
}

Ahead ahead_of(Ray ray, bool is_seen, uint behind, uint begin, uint end, uvec2 own) {
    uint before = (ray.begin + behind) / BLOCK;
    uint most = is_seen && has_runs() ? MAX_RUNS : 0;
    Ahead ahead = Ahead(0, 0, first_run(own), most, before, ray.end + behind);
    next_run(ahead);
    return ahead;
}

// A bit for each of the pieces, so many samples long, in which this ray has any.
uint pieces_from(inout Ahead ahead, uint first, uint samples) {
    while (ahead.to <= first) next_run(ahead);
    uint limit = first + LOOKERS * samples;
    uint pieces = 0;
    Ahead at = ahead;
    while (at.from < limit) {
        uint lo = (max(at.from, first) - first) / samples;
        uint hi = (min(at.to, limit) - 1 - first) / samples;
        pieces |= 0xffffffffu >> (31 - hi) & 0xffffffffu << lo;
        if (at.to >= limit) break;
        next_run(at);
    }
    return pieces;
}

uint rounds_from(inout Ahead ahead, uint first, bool has_ended) {
    return subgroupOr(has_ended ? 0 : pieces_from(ahead, first, ROUND));
}

uint stretches_from(inout Ahead ahead, uint first, bool has_ended) {
    return subgroupOr(has_ended ? 0 : pieces_from(ahead, first, STRETCH));
}
