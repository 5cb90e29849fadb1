// Rays that were traced: their runs are read, which another shader found.

struct Walk {
    // Where the next run lies, how many there may be after it, and what it is.
    uint place;
    uint left;
    uint next;
    // Blocks before the ray's first.
    uint before;
};

Walk walk_of(Ray ray) {
    uint place = SKIPPING ? first_run(own_pixel()) : 0;
    uint next = SKIPPING && has_runs() ? push.runs.word[place] : 0;
    return Walk(place, MAX_RUNS - 1, next, ray.begin / BLOCK);
}

void seek(Ray ray, inout Walk walk, inout uint k, inout uint stop) {
    while (k >= stop && k < ray.end) {
        uint run = walk.next;
        if (run == 0) {
            k = ray.end;
            break;
        }
        walk.place += RUN_STRIDE;
        walk.next = walk.left > 0 ? push.runs.word[walk.place] : 0;
        walk.left -= min(walk.left, 1);
        uint end = run >> 16;
        stop = end == OPEN_END ? ray.end : min((walk.before + end) * BLOCK, ray.end);
        k = max(k, (walk.before + (run & 0xffffu)) * BLOCK);
    }
}
