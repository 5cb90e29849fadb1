// From what was fetched for a sample to what its ray has gathered.

// Adds sample `k`, which was fetched.
void add(inout Pixel pixel, Ray ray, float k, float optical_length, Sample s) {
    if (!evaluate(s)) return;
    if (MAXIMUM) {
        maximise(pixel, k, s.value);
        return;
    }
    float coordinate = table_coordinate(s.value);
    uint bin = min(uint(coordinate), uint(TRANSFER_BINS - 1));
    float t = coordinate - float(bin);
    float extinction = extinction_at(bin, t);
    if (extinction <= 0.0) return;
    vec3 color = color_at(bin, t);
    if (SHADED) {
        vec2 lit = shade(gradient(s), ray.direction);
        precise vec3 lit_color = fma(color, vec3(lit.x), vec3(lit.y));
        color = lit_color;
    }
    composite(pixel, k, extinction, optical_length, color);
}
