// `grid`: rays step over boxes of macrocells that the distance map knows to be empty.

struct Walk {
    vec3 inverse_step;
};

Walk walk_of(Ray ray) {
    return Walk(1.0 / ray.step);
}

void seek(Ray ray, inout Walk walk, inout uint k, inout uint stop) {
    while (k >= stop && k < ray.end) {
        uint next;
        uint apart = look_ahead(ray, walk.inverse_step, k, next);
        stop = min(next, ray.end);
        if (apart > 0) k = stop;
    }
}
