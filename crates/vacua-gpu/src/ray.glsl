// From a pixel to the samples of its ray: the twin of `vacua_render`'s ray setup. Sample k of a ray
// is at fma(k, step, start) on each axis, which decides its cell and macrocell for all methods.
//
// In `f64` is only what far cameras need: how many steps lie between the camera and the ray's anchor
// near the volume. The rest starts from the anchor and keeps its digits in `f32`. All of it is `precise`:
// one shader finds where a ray meets what is active, another one samples it, and both must number its
// samples alike whatever their compiler would make of them.

struct Ray {
    vec3 start;
    vec3 step;
    // Unit direction in ray space (of world length 1).
    vec3 direction;
    // World distance between samples, and of sample 0 from the camera.
    float dt;
    float t_start;
    // The samples that are seen.
    uint begin;
    uint end;
    // Windows of ALIGNMENT samples before sample 0, counted from the camera.
    uint window;
};

vec3 position(Ray ray, float k) {
    precise vec3 at = fma(vec3(k), ray.step, ray.start);
    return at;
}

// Half the distance from a number to the next larger one.
float half_gap(float x) {
    float size = abs(x);
    return 0.5 * (uintBitsToFloat(floatBitsToUint(size) + 1u) - size);
}

// Cuts the samples to those with lo <= coordinate <= hi on one axis: an estimate, settled with the
// computed coordinates.
void cut(inout Ray ray, int axis, float lo, float hi) {
    float start = ray.start[axis];
    float step = ray.step[axis];
    if (step == 0.0) {
        if (!(lo <= start && start <= hi)) ray.end = 0;
        return;
    }
    float first = step > 0.0 ? (lo - start - half_gap(lo)) / step : (hi - start + half_gap(hi)) / step;
    float last = step > 0.0 ? (hi - start + half_gap(hi)) / step : (lo - start - half_gap(lo)) / step;
    float limit = float(MAX_SAMPLES);
    float begin = clamp(ceil(first), 0.0, limit);
    float end = clamp(floor(last), -1.0, limit - 1.0) + 1.0;
    float sign_of_step = step > 0.0 ? 1.0 : -1.0;
    float enter = sign_of_step * (step > 0.0 ? lo : hi);
    float leave = sign_of_step * (step > 0.0 ? hi : lo);
    const int MOST = 64;
    for (int i = 0; i < MOST && begin > 0.0; ++i) {
        if (sign_of_step * position(ray, begin - 1.0)[axis] < enter) break;
        begin -= 1.0;
    }
    for (int i = 0; i < MOST && begin < limit; ++i) {
        if (!(sign_of_step * position(ray, begin)[axis] < enter)) break;
        begin += 1.0;
    }
    for (int i = 0; i < MOST && end < limit; ++i) {
        if (sign_of_step * position(ray, end)[axis] > leave) break;
        end += 1.0;
    }
    for (int i = 0; i < MOST && end > 0.0; ++i) {
        if (!(sign_of_step * position(ray, end - 1.0)[axis] > leave)) break;
        end -= 1.0;
    }
    ray.begin = max(ray.begin, uint(begin));
    ray.end = min(ray.end, uint(end));
}

// Thresholds of an ordered dither over 4 × 4 pixels.
float interleave(uvec2 pixel) {
    const uint ROWS[4] = uint[](0xa280u, 0x6e4cu, 0x91b3u, 0x5d7fu);
    uint value = ROWS[pixel.y & 3u] >> (4 * (pixel.x & 3u)) & 15u;
    return (float(value) + 0.5) / 16.0;
}

// The ray through a pixel; `end <= begin` if no sample is seen.
Ray ray_of(uvec2 pixel) {
    Ray ray;
    ray.begin = 0;
    ray.end = 0;
    ray.window = 0;
    precise double x =
        (double(pixel.x) + double(push.offset.x)) * parameters.grid.y - 1.0;
    precise double y =
        1.0 - (double(pixel.y) + double(push.offset.y)) * parameters.grid.z;
    precise dvec3 rate =
        parameters.rate.xyz + x * parameters.rate_x.xyz + y * parameters.rate_y.xyz;
    precise double speed = sqrt(dot(rate, rate));
    precise double anchor_sample = parameters.grid.x * speed;
    precise float fx = float(x);
    precise float fy = float(y);
    precise vec3 anchor = fma(
        vec3(fx), parameters.anchor_x.xyz, fma(vec3(fy), parameters.anchor_y.xyz, parameters.anchor.xyz)
    );
    precise vec3 direction = fma(
        vec3(fx),
        parameters.direction_x.xyz,
        fma(vec3(fy), parameters.direction_y.xyz, parameters.direction.xyz)
    );
    vec3 squares = parameters.length_sq.xyz;
    precise float length_sq = fma(fx * fx, squares.y, fma(fy * fy, squares.z, squares.x));
    precise float world_length = sqrt(length_sq);
    precise float scale = parameters.box_lo.w / float(speed);
    precise vec3 step = direction * scale;
    precise float dt = world_length * scale;
    ray.step = step;
    ray.direction = direction / world_length;
    ray.dt = dt;
    // Where the box is, in samples from the anchor.
    precise vec3 inverse = 1.0 / step;
    precise float enter = -LARGEST;
    precise float leave = LARGEST;
    for (int a = 0; a < 3; ++a) {
        float lo = parameters.box_lo[a];
        float hi = parameters.box_hi[a];
        if (step[a] == 0.0) {
            if (anchor[a] < lo || anchor[a] > hi) return ray;
            continue;
        }
        float p = (lo - anchor[a]) * inverse[a];
        float q = (hi - anchor[a]) * inverse[a];
        enter = max(enter, min(p, q));
        leave = min(leave, max(p, q));
    }
    // Rays that graze the box may still have a sample whose computed position lies in it.
    precise float slack = 2.0 + 1e-5 * (abs(enter) + abs(leave));
    if (enter > leave + slack || anchor_sample + double(leave + slack) < 0.0) return ray;
    float jitter = 0.0;
    if (push.jitter >= 0.0) jitter = fract(interleave(pixel) + push.jitter);
    precise double entered = max(anchor_sample + double(enter - slack), 0.0);
    precise double base = floor(entered / double(ALIGNMENT)) * double(ALIGNMENT);
    precise double from_anchor = base + double(jitter) - anchor_sample;
    precise vec3 start = fma(vec3(float(from_anchor)), step, anchor);
    ray.start = start;
    ray.window = uint(min(base / double(ALIGNMENT), 4e9LF));
    ray.t_start = float((base + double(jitter)) * double(ray.dt));
    ray.end = MAX_SAMPLES;
    for (int a = 0; a < 3; ++a) cut(ray, a, parameters.box_lo[a], parameters.box_hi[a]);
    for (uint i = 0; i < parameters.axis_offset.w; ++i) {
        vec4 plane = push.clips.quad[i];
        precise float height =
            fma(plane.x, start.x, fma(plane.y, start.y, fma(plane.z, start.z, plane.w)));
        precise float rise = fma(plane.x, step.x, fma(plane.y, step.y, plane.z * step.z));
        float crossing = clamp(-height / rise, -1.0, float(MAX_SAMPLES));
        if (rise > 0.0) ray.begin = max(ray.begin, uint(max(ceil(crossing), 0.0)));
        if (rise < 0.0) ray.end = min(ray.end, uint(floor(crossing) + 1.0));
        if (rise == 0.0 && height < 0.0) ray.end = 0;
    }
    return ray;
}

// Rows of the picture that this device makes: bands of as many rows as a workgroup, dealt out in
// turn to the devices that share a picture.
uint global_row(uint row) {
    uint share = parameters.picture.w;
    return ((row / 16u) * (share >> 16) + (share & 0xffffu)) * 16u + row % 16u;
}
