// Beams: what all rays of a subgroup pass through. In numbers of samples that a subgroup's rays have in
// common, the coordinates of all of them lie in a box that moves and grows linearly.

struct Beam {
    vec3 lo;
    vec3 lo_step;
    vec3 hi;
    vec3 hi_step;
};

// The beam of this subgroup; a ray is `behind` with its numbers.
Beam beam_of(Ray ray, bool is_seen, uint behind) {
    // What rounding moves coordinates by, and those of a start that is moved.
    float slack = 2.0 * parameters.length_sq.w;
    const float FAR = 1e30;
    vec3 start = fma(vec3(-float(behind)), ray.step, ray.start);
    Beam beam;
    beam.lo = subgroupMin(is_seen ? start : vec3(FAR)) - slack;
    beam.hi = subgroupMax(is_seen ? start : vec3(-FAR)) + slack;
    beam.lo_step = subgroupMin(is_seen ? ray.step : vec3(FAR));
    beam.hi_step = subgroupMax(is_seen ? ray.step : vec3(-FAR));
    return beam;
}
