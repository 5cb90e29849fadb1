// A sample of a volume on a grid: fetching, interpolating, and the gradient there.

struct Sample {
    vec3 cell;
    vec3 fraction;
    // Corners below and above along z, as `gather` has them.
    vec4 front;
    vec4 back;
    float value;
};

float lerp(float t, float a, float b) {
    precise float mixed = fma(t, b - a, a);
    return mixed;
}

// Corners interpolated along x, the lower row first.
vec2 along_x(float t, vec4 corners) {
    return vec2(lerp(t, corners.w, corners.z), lerp(t, corners.x, corners.y));
}

// Fetches what a sample needs; what becomes of it is computed later, so that several fetches are
// under way at once.
Sample fetch_at(vec3 at) {
    Sample s;
    s.cell = cell_of(at);
    if (CELL_DATA) {
        s.value = fetch(s.cell);
    } else {
        s.fraction = fraction_of(at, s.cell);
        int slab = slab_of(s.cell.z);
        vec2 corner = s.cell.xy + 1.0;
        s.front = gather(slab, corner, s.cell.z);
        s.back = gather(slab, corner, s.cell.z + 1.0);
    }
    return s;
}

// The value of what was fetched, and whether there is one.
bool evaluate(inout Sample s) {
    if (!CELL_DATA) {
        vec2 front = along_x(s.fraction.x, s.front);
        vec2 back = along_x(s.fraction.x, s.back);
        s.value = lerp(
            s.fraction.z,
            lerp(s.fraction.y, front.x, front.y),
            lerp(s.fraction.y, back.x, back.y)
        );
    }
    s.value = value_of(s.value);
    return (!CHECK_FINITE || is_finite(s.value)) && !is_blanked(s.cell);
}

// Central differences at the second and third of four values, interpolated between them.
float slope(vec4 line, float t, vec2 inverse_spans) {
    precise float lower = (line.z - line.x) * inverse_spans.x;
    precise float upper = (line.w - line.y) * inverse_spans.y;
    return lerp(t, lower, upper);
}

// One over the distances between the points before a cell's ends and after them.
vec2 inverse_spans(int axis, float cell) {
    uint here = uint(cell);
    uint before = here == 0 ? 0 : here - 1;
    uint after = min(here + 2, parameters.cells[axis]);
    return vec2(
        1.0 / (plane_at(axis, here + 1) - plane_at(axis, before)),
        1.0 / (plane_at(axis, after) - plane_at(axis, here))
    );
}

// The gradient in ray space: central differences at the points, one-sided at the ends.
vec3 gradient(Sample s) {
    if (CELL_DATA) return vec3(0.0);
    int slab = slab_of(s.cell.z);
    vec2 corner = s.cell.xy + 1.0;
    vec3 f = s.fraction;
    vec2 spans_x = inverse_spans(0, s.cell.x);
    vec2 spans_y = inverse_spans(1, s.cell.y);
    vec2 spans_z = inverse_spans(2, s.cell.z);
    vec2 x_slopes[2];
    float y_slopes[2];
    vec2 here[2];
    for (int i = 0; i < 2; ++i) {
        float layer = s.cell.z + float(i);
        vec4 middle = i == 0 ? s.front : s.back;
        vec4 left = gather(slab, corner - vec2(1.0, 0.0), layer);
        vec4 right = gather(slab, corner + vec2(1.0, 0.0), layer);
        vec4 below = gather(slab, corner - vec2(0.0, 1.0), layer);
        vec4 above = gather(slab, corner + vec2(0.0, 1.0), layer);
        here[i] = along_x(f.x, middle);
        x_slopes[i] = vec2(
            slope(vec4(left.w, middle.w, middle.z, right.z), f.x, spans_x),
            slope(vec4(left.x, middle.x, middle.y, right.y), f.x, spans_x)
        );
        float before = lerp(f.x, below.w, below.z);
        float after = lerp(f.x, above.x, above.y);
        y_slopes[i] = slope(vec4(before, here[i], after), f.y, spans_y);
    }
    float layer_before = max(s.cell.z - 1.0, 0.0);
    float layer_after = min(s.cell.z + 2.0, float(parameters.cells.z));
    vec2 before = along_x(f.x, gather(slab, corner, layer_before));
    vec2 after = along_x(f.x, gather(slab, corner, layer_after));
    vec2 z_slopes = vec2(
        slope(vec4(before.x, here[0].x, here[1].x, after.x), f.z, spans_z),
        slope(vec4(before.y, here[0].y, here[1].y, after.y), f.z, spans_z)
    );
    return vec3(
        lerp(f.z, lerp(f.y, x_slopes[0].x, x_slopes[0].y), lerp(f.y, x_slopes[1].x, x_slopes[1].y)),
        lerp(f.z, y_slopes[0], y_slopes[1]),
        lerp(f.y, z_slopes.x, z_slopes.y)
    ) * parameters.texel.z;
}
