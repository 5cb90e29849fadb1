// Finds the runs of a ray.
//
// The including stage says how empty space is skipped: `Walk` is what a ray keeps for that, made by
// `walk_of`, and `seek` moves k to the next sample that may be active, and `stop` to the end of those
// that follow it without a gap.

void find(Ray ray, uint place) {
    uint before = ray.begin / BLOCK;
    uint num = 0;
    uint run_first = 0;
    uint run_end = 0;
    Walk walk = walk_of(ray);
    uint k = ray.begin;
    while (k < ray.end) {
        uint stop = k;
        seek(ray, walk, k, stop);
        if (k >= ray.end) break;
        uint first = min(k / BLOCK - before, OPEN_END - 1);
        // What follows in the last block is sampled too, so that no block is visited twice.
        k = (min(stop, ray.end) + BLOCK - 1) & ~(BLOCK - 1);
        bool is_apart = first > run_end;
        if (is_apart && run_end > 0 && num + 1 < MAX_RUNS) {
            push.runs.word[place + num * RUN_STRIDE] = run_first | run_end << 16;
            ++num;
            run_end = 0;
        }
        if (is_apart && run_end == 0) run_first = first;
        run_end = min(k / BLOCK - before, OPEN_END);
    }
    if (run_end > 0) {
        push.runs.word[place + num * RUN_STRIDE] = run_first | run_end << 16;
        ++num;
    }
    if (num < MAX_RUNS) push.runs.word[place + num * RUN_STRIDE] = 0;
}

// Finds the runs of a pixel's ray, by its place in this device's own rows.
void find_pixel(uvec2 own) {
    uvec2 at = uvec2(own.x, global_row(own.y));
    if (at.x >= parameters.picture.x || at.y >= parameters.picture.y) return;
    find(ray_of(at), first_run(own));
}
