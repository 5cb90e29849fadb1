// `grid`: rays step over boxes of macrocells that the distance map knows to be alike.

struct Walk {
    // Samples to the far plane of such a box: rate · macrocell + pace · distance + base, on each axis.
    vec3 rate;
    vec3 pace;
    vec3 base;
};

Walk walk_of(Ray ray) {
    Walk walk;
    float side = float(parameters.macrocells.w);
    bvec3 upward = greaterThanEqual(ray.step, vec3(0.0));
    bvec3 stands = equal(ray.step, vec3(0.0));
    vec3 inverse = 1.0 / ray.step;
    // Computed coordinates may reach a plane a few roundings before the line does, and this sum has
    // roundings of its own.
    float slack = 2.0 * parameters.length_sq.w;
    vec3 base = (mix(vec3(side + slack), vec3(-slack), upward) - ray.start) * inverse;
    walk.rate = mix(side * inverse, vec3(0.0), stands);
    walk.pace = abs(walk.rate);
    walk.base = mix(base, vec3(LARGEST), stands);
    return walk;
}

void seek(Ray ray, inout Walk walk, inout uint k, inout uint stop) {
    uint nearest;
    do {
        k = stop;
        if (k >= ray.end) return;
        if (RECTILINEAR) {
            nearest = look_ahead(ray, 1.0 / ray.step, k, stop);
        } else {
            vec3 macrocell = macrocell_of(position(ray, float(k)));
            nearest = distance_at(macrocell);
            vec3 distance = vec3(float(max(nearest, 1u)));
            vec3 crossing = fma(macrocell, walk.rate, fma(distance, walk.pace, walk.base));
            float leave = min(crossing.x, min(crossing.y, crossing.z));
            // Rounding down by more than the arithmetic can be off never passes a sample.
            float bound = ceil(leave * (1.0 - 2e-6));
            stop = max(k + 1, uint(clamp(bound, 0.0, float(MAX_SAMPLES))));
        }
    } while (nearest > 0);
}
