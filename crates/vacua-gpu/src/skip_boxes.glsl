// `boxes`: rays go from proxy box to proxy box, whichever begins nearest (Ganter and Manzke 2019, as
// paper A §3 has it).
//
// The including stage has `first_box`.

// The first box that a half-line is in beyond `t_min`, and where it enters it.
Hit first_box(vec3 origin, float t_min, vec3 direction, float t_max);

struct Walk {
    // Rays are traced from this sample on, before the first that is seen.
    float base;
    vec3 origin;
    float t_max;
};

Walk walk_of(Ray ray) {
    Walk walk;
    walk.base = float(ray.begin) - 2.0;
    walk.origin = position(ray, walk.base);
    walk.t_max = float(ray.end) - walk.base + 1.0;
    return walk;
}

void seek(Ray ray, inout Walk walk, inout uint k, inout uint stop) {
    float limit = float(ray.end);
    float margin = fma(4e-6, float(k), 0.01);
    float t_min = max(float(k) - walk.base - margin, 0.0);
    Hit hit = first_box(walk.origin, t_min, ray.step, walk.t_max);
    if (hit.primitive == NO_HIT) {
        k = ray.end;
        stop = k;
        return;
    }
    // What begins a rounding earlier than the box that was found may be another one.
    float enter = hit.t + walk.base;
    enter -= fma(4e-6, abs(enter), 0.01);
    float leave = span_of(hit.primitive, ray.start, ray.step).y;
    k = max(k, uint(clamp(ceil(enter), 0.0, limit)));
    stop = max(uint(clamp(floor(leave) + 1.0, 0.0, limit)), k + 1);
}
