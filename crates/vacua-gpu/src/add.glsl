// From what was fetched for a sample to what its ray has gathered.

// Adds sample `k`, which was fetched.
void add(inout Pixel pixel, Ray ray, float k, float optical_length, Sample s) {
    if (!evaluate(s)) return;
    Seen seen = see(pixel, k, s.value);
    if (seen.extinction <= 0.0) return;
    vec2 light = SHADED ? shade(gradient(s), ray.direction) : vec2(1.0, 0.0);
    composite(pixel, k, seen, optical_length, light);
}
