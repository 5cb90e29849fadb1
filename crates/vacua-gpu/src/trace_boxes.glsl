// `boxes`: rays go from proxy box to proxy box, whichever begins nearest (Ganter and Manzke 2019, as
// paper A §3 has it).
//
// The including stage has `first_box`.

// The first box that a half-line is in beyond `t_min`, and where it enters it.
Hit first_box(vec3 origin, float t_min, vec3 direction, float t_max);

// Moves k to the first sample at or beyond it that may be in a box; the first beyond the box. Both are the
// ray's end if there is none.
uint seek(Ray ray, vec3 origin, float base, inout uint k) {
    float limit = float(ray.end);
    float margin = fma(4e-6, float(k), 0.01);
    float t_min = max(float(k) - base - margin, 0.0);
    Hit hit = first_box(origin, t_min, ray.step, limit - base + 1.0);
    if (hit.primitive == NO_HIT) {
        k = ray.end;
        return k;
    }
    // What begins a rounding earlier than the box that was found may be another one.
    float enter = hit.t + base;
    enter -= fma(4e-6, abs(enter), 0.01);
    float leave = span_of(hit.primitive, ray.start, ray.step).y;
    k = max(k, uint(clamp(ceil(enter), 0.0, limit)));
    return max(uint(clamp(floor(leave) + 1.0, 0.0, limit)), k + 1);
}

// Finds the runs of a pixel's ray, by its place in this device's own rows.
void find_pixel(uvec2 own) {
    uvec2 at = uvec2(own.x, global_row(own.y));
    if (at.x >= parameters.picture.x || at.y >= parameters.picture.y) return;
    Ray ray = ray_of(at);
    Runs runs = runs_of(ray, first_run(own));
    // Rays are traced from before the first sample that is seen.
    float base = float(ray.begin) - 2.0;
    vec3 origin = position(ray, base);
    uint k = ray.begin;
    while (k < ray.end) {
        uint stop = seek(ray, origin, base, k);
        if (k < ray.end) k = add_run(runs, ray, k, stop);
    }
    close(runs);
}
