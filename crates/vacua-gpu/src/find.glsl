// Writes the runs of rays, by methods that find them before they are sampled.

// The runs of a ray as they are found.
struct Runs {
    // Where the next one is written.
    uint place;
    // Blocks before the ray's first.
    uint before;
    // Those that are written, and the one that may yet grow.
    uint num;
    uint first;
    uint end;
};

Runs runs_of(Ray ray, uint place) {
    return Runs(place, ray.begin / BLOCK, 0, 0, 0);
}

void write_run(inout Runs runs) {
    push.runs.word[runs.place] = runs.first | runs.end << 16;
    runs.place += RUN_STRIDE;
    ++runs.num;
}

// Adds the samples from k to `stop`; the first that does not belong to the run. What follows in the last
// block is sampled too, so that no block is visited twice.
uint add_run(inout Runs runs, Ray ray, uint k, uint stop) {
    uint first = min(k / BLOCK - runs.before, OPEN_END - 1);
    k = (min(stop, ray.end) + BLOCK - 1) & ~(BLOCK - 1);
    bool is_apart = first > runs.end;
    if (is_apart && runs.end > 0 && runs.num + 1 < MAX_RUNS) {
        write_run(runs);
        runs.end = 0;
    }
    if (is_apart && runs.end == 0) runs.first = first;
    runs.end = min(k / BLOCK - runs.before, OPEN_END);
    return k;
}

// Writes what is left.
void close(inout Runs runs) {
    if (runs.end > 0) write_run(runs);
    if (runs.num < MAX_RUNS) push.runs.word[runs.place] = 0;
}
