// Where a line is within a proxy box, a little wider than it is: past the rounding of computed
// coordinates and of the division. An empty span if it misses the box.

vec2 span_of(uint box, vec3 origin, vec3 direction) {
    float enter = -LARGEST;
    float leave = LARGEST;
    float slack = parameters.length_sq.w;
    for (int a = 0; a < 3; ++a) {
        float lo = uintBitsToFloat(parameters.faces.word[6 * box + a]) - slack;
        float hi = uintBitsToFloat(parameters.faces.word[6 * box + 3 + a]) + slack;
        if (direction[a] == 0.0) {
            if (origin[a] < lo || origin[a] > hi) return vec2(1.0, 0.0);
            continue;
        }
        float p = (lo - origin[a]) / direction[a];
        float q = (hi - origin[a]) / direction[a];
        enter = max(enter, min(p, q));
        leave = min(leave, max(p, q));
    }
    return vec2(enter - 2e-6 * abs(enter), leave + 2e-6 * abs(leave));
}
