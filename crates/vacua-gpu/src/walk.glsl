// How far a ray may go on before it looks again, by the map of macrocells.

// Distance of a sample's macrocell to the nearest active one, 0 if it is active itself; and the
// first sample that may lie outside the box of macrocells that are known to be alike.
uint look_ahead(Ray ray, vec3 inverse_step, uint k, out uint next) {
    vec3 at = macrocell_of(position(ray, float(k)));
    uint apart = distance_of(map_at(uvec3(at)));
    float side = float(parameters.macrocells.w);
    float reach = float(max(apart, 1u)) * side;
    bvec3 upward = greaterThanEqual(ray.step, vec3(0.0));
    vec3 plane = at * side + mix(vec3(side - reach), vec3(reach), upward);
    if (RECTILINEAR) {
        for (int a = 0; a < 3; ++a) {
            uint cell = uint(clamp(plane[a], 0.0, float(parameters.cells[a])));
            plane[a] = plane_at(a, cell);
        }
    }
    // A computed coordinate may reach a plane a few roundings before the line does, more so where
    // `fma` rounds twice, as it may.
    float slack = parameters.length_sq.w;
    vec3 ahead = ray.start + mix(vec3(-slack), vec3(slack), upward);
    precise vec3 crossing = (plane - ahead) * inverse_step;
    crossing = mix(crossing, vec3(LARGEST), equal(ray.step, vec3(0.0)));
    float leave = min(crossing.x, min(crossing.y, crossing.z));
    // Rounding down by more than the arithmetic can be off never passes a sample.
    float bound = ceil(leave * (1.0 - 2e-6));
    next = max(k + 1, uint(clamp(bound, 0.0, float(MAX_SAMPLES))));
    return apart;
}
