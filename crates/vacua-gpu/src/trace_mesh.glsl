// `mesh` by tracing rays against an acceleration structure.
//
// The including stage has `first_hit`.

// The first face that a half-line meets beyond `t_min` and before `t_max`: of those that it sees from
// behind where `from_inside`, else of those that it sees from the front.
Hit first_hit(vec3 origin, float t_min, vec3 direction, float t_max, bool from_inside);

// The face that is sought.
uint first_face(Ray ray, Walk walk) {
    // Rays are traced from before the first sample that is seen.
    float base = float(ray.begin) - 2.0;
    vec3 origin = position(ray, base);
    float t_max = last_crossing(ray) - base;
    float t_min = max(float(walk.at) - 0.5 - walk.reach - base, 0.0);
    while (true) {
        Hit hit = first_hit(origin, t_min, ray.step, t_max, walk.sought == BACK);
        if (hit.primitive == NO_HIT) return NO_FACE;
        uint face = hit.primitive / 2;
        if (samples_around(ray, walk, face).y > walk.at) return face;
        // This one has been passed, or the ray runs along it.
        t_min = uintBitsToFloat(floatBitsToUint(max(hit.t, t_min)) + 1u);
    }
}

// Finds the runs of a pixel's ray, by its place in this device's own rows.
void find_pixel(uvec2 own) {
    uvec2 at = uvec2(own.x, global_row(own.y));
    if (at.x >= parameters.picture.x || at.y >= parameters.picture.y) return;
    Ray ray = ray_of(at);
    Runs runs = runs_of(ray, first_run(own));
    Walk walk = walk_of(ray, runs);
    while (walk.sought != NOTHING) take(ray, walk, runs, first_face(ray, walk));
    close(runs);
}
