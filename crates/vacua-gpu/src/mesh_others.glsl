// Pyramids, wedges and hexahedra: the inverse of their maps. Twins of `vacua_pack`'s vector code: by
// Newton's method in `f32`, with a bound on how far each iterate is from that of exact arithmetic.
// What that leaves in doubt, `f64` decides, by the very operations of the scalar code.

// Steps before a place is left to `f64`.
const int NEWTON_STEPS = 6;
// A last step this small is the last.
const float LAST_STEP = 1.0 / 1024.0;
// An error this large, in local coordinates, makes a place uncertain.
const float LOST = 1.0 / 32.0;
// Local coordinates this far out are given up.
const float FAR = 3.0;
// Bound on the rounding of a solution, and by how much solving can enlarge a right-hand side; both
// divided by column length and relative determinant (`enlarged`).
const float NEWTON_ROUNDING = 512.0 / 16777216.0;
const float SOLVING = 8.0;
// A pyramid's apex, in units of its size, within which base coordinates mean too little.
const float NEAR_APEX = 1.0 / 64.0;

// Weights of up to eight corners, the first four and the last four.
struct Weights {
    vec4 low;
    vec4 high;
};

float largest_of(vec3 a) {
    return max(max(abs(a.x), abs(a.y)), abs(a.z));
}

// Lengths of columns, without the shortest, over their determinant.
float enlarged_by(vec3 a, vec3 b, vec3 c, float inverse) {
    vec3 lengths = vec3(largest_of(a), largest_of(b), largest_of(c));
    vec3 pairs = lengths * lengths.yzx;
    precise float enlarged = max(max(pairs.x, pairs.y), pairs.z) * abs(inverse);
    return enlarged;
}

vec3 add_scaled(vec3 a, float s, vec3 b) {
    precise vec3 sum = fma(vec3(s), b, a);
    return sum;
}

// `x` with `columns · x = right`; `enlarged`: one over the shortest column and the determinant over the
// columns' lengths.
vec3 solve(vec3 a, vec3 b, vec3 c, vec3 right, out float enlarged) {
    vec3 bc = cross_of(b, c);
    precise float inverse = 1.0 / dot_of(a, bc);
    precise vec3 x =
        vec3(dot_of(right, bc), dot_of(right, cross_of(c, a)), dot_of(right, cross_of(a, b)))
        * inverse;
    enlarged = enlarged_by(a, b, c, inverse);
    return x;
}

// Coefficients of a cell's map, its corners seen from the place. Hexahedron: 1, r, s, t, rs, st, tr,
// rst. Wedge: 1, r, s, t, and the twists of r and s. Pyramid: corner, a, b, bend, target.
struct Map {
    vec3 c[8];
    float bend;
};

// Value and derivatives of a map.
void map_at(uint kind, Map map, vec3 x, out vec3 value, out vec3 dx, out vec3 dy, out vec3 dz) {
    if (kind == HEXAHEDRON) {
        vec3 rs_t = add_scaled(map.c[4], x.z, map.c[7]);
        dx = add_scaled(add_scaled(map.c[1], x.z, map.c[6]), x.y, rs_t);
        dy = add_scaled(add_scaled(map.c[2], x.z, map.c[5]), x.x, rs_t);
        vec3 tr_s = add_scaled(map.c[6], x.y, map.c[7]);
        dz = add_scaled(add_scaled(map.c[3], x.y, map.c[5]), x.x, tr_s);
        vec3 plane = add_scaled(map.c[0], x.y, add_scaled(map.c[2], x.z, map.c[5]));
        value = add_scaled(add_scaled(plane, x.z, map.c[3]), x.x, dx);
    } else if (kind == WEDGE) {
        dx = add_scaled(map.c[1], x.z, map.c[4]);
        dy = add_scaled(map.c[2], x.z, map.c[5]);
        dz = add_scaled(add_scaled(map.c[3], x.x, map.c[4]), x.y, map.c[5]);
        value = add_scaled(add_scaled(add_scaled(map.c[0], x.z, map.c[3]), x.x, dx), x.y, dy);
    } else {
        float r = x.y / x.x;
        float s = x.z / x.x;
        precise vec3 sum = fma(vec3(x.y), map.c[1], x.x * map.c[0]);
        sum = add_scaled(add_scaled(sum, x.z, map.c[2]), x.y * s, map.c[3]);
        precise vec3 apart = sum - map.c[4];
        value = apart;
        dx = add_scaled(map.c[0], -(r * s), map.c[3]);
        dy = add_scaled(map.c[1], s, map.c[3]);
        dz = add_scaled(map.c[2], r, map.c[3]);
    }
}

// Bound on the second derivatives around some coordinates.
float bend_at(uint kind, Map map, vec3 x) {
    if (kind != PYRAMID) return map.bend;
    // Of u·v/w, with half of w to spare for the way of a step.
    float r = abs(x.y) / x.x + 1.0;
    float s = abs(x.z) / x.x + 1.0;
    float bend = map.bend * (8.0 * r * s / x.x);
    return x.x > 1.0 / 64.0 ? bend : 3e38;
}

// Local coordinates at which a map is zero, from a start that is off by `error`; `margin` is how far
// they may be off, `certain` whether that is a bound.
vec3 newton(uint kind, Map map, vec3 start, float error, out float margin, out bool certain) {
    vec3 x = start;
    certain = true;
    margin = 3e38;
    for (int i = 0; i < NEWTON_STEPS; ++i) {
        vec3 value, dx, dy, dz;
        map_at(kind, map, x, value, dx, dy, dz);
        float enlarged;
        vec3 step = solve(dx, dy, dz, value, enlarged);
        precise float growth = bend_at(kind, map, x) * (enlarged * SOLVING);
        precise vec3 next = x - step;
        x = next;
        float size = largest_of(step);
        precise float after = fma(growth * error, size + error, enlarged * NEWTON_ROUNDING);
        error = after;
        // Comparisons with what is not a number fail.
        certain = error < LOST && largest_of(x) < FAR;
        if (!certain) return x;
        precise float left = fma(growth * size, size, error);
        margin = left;
        if (size < LAST_STEP && margin < LOST) return x;
    }
    certain = margin < LOST;
    return x;
}

uint verdict_of(bool certain, float least, float margin) {
    if (certain && margin < least) return INSIDE;
    if (certain && least < -margin) return OUTSIDE;
    return IN_DOUBT;
}

// The power of two that brings sizes to between 1 and 2; 0 where there is none.
float scale_of(float size) {
    bool is_tame = size > 1e-30 && size < 1e30;
    return is_tame ? uintBitsToFloat(0x7f000000u - (floatBitsToUint(size) & 0x7f800000u)) : 0.0;
}

// A hexahedron's map as it is wherever it is seen from, and what the first of Newton's steps, from its
// middle, needs.
struct Hexahedron {
    vec3 corner;
    float scale;
    // Coefficients from that of r on, scaled.
    vec3 c[7];
    // The inverse of the derivatives in the middle, row by row, and how much that enlarges.
    vec3 rows[3];
    float enlarged;
};

Hexahedron hexahedron_of(vec3 p[8]) {
    Hexahedron h;
    vec3 lo = p[0];
    vec3 hi = p[0];
    for (int k = 1; k < 8; ++k) {
        lo = min(lo, p[k]);
        hi = max(hi, p[k]);
    }
    h.corner = p[0];
    h.scale = scale_of(largest_of(hi - lo));
    precise vec3 a = (p[1] - p[0]) * h.scale;
    precise vec3 b = (p[3] - p[0]) * h.scale;
    precise vec3 c = (p[4] - p[0]) * h.scale;
    precise vec3 across = (p[5] - p[4]) * h.scale;
    precise vec3 rs = (p[2] - p[3]) * h.scale - a;
    precise vec3 st = (p[7] - p[4]) * h.scale - b;
    precise vec3 tr = across - a;
    precise vec3 rst = ((p[6] - p[7]) * h.scale - across) - rs;
    h.c = vec3[7](a, b, c, rs, st, tr, rst);
    Map map;
    map.c = vec3[8](vec3(0.0), a, b, c, rs, st, tr, rst);
    vec3 middle, dx, dy, dz;
    map_at(HEXAHEDRON, map, vec3(0.5), middle, dx, dy, dz);
    vec3 yz = cross_of(dy, dz);
    precise float inverse = 1.0 / dot_of(dx, yz);
    precise vec3 first = yz * inverse;
    precise vec3 second = cross_of(dz, dx) * inverse;
    precise vec3 third = cross_of(dx, dy) * inverse;
    h.rows = vec3[3](first, second, third);
    h.enlarged = enlarged_by(dx, dy, dz, inverse);
    return h;
}

// What `f32` says of a hexahedron and a place in the box around its corners; the weights if it is inside.
uint hexahedron_verdict(Hexahedron h, vec3 at, out Weights weights) {
    weights = Weights(vec4(0.0), vec4(0.0));
    precise vec3 corner = (h.corner - at) * h.scale;
    // The place seen from the middle, times eight.
    precise vec3 eighths = (h.c[3] + h.c[4]) + h.c[5];
    eighths = fma(vec3(2.0), eighths, h.c[6]);
    eighths = fma(vec3(4.0), (h.c[0] + h.c[1]) + h.c[2], eighths);
    precise vec3 value = fma(vec3(0.125), eighths, corner);
    precise vec3 start =
        0.5 - vec3(dot_of(h.rows[0], value), dot_of(h.rows[1], value), dot_of(h.rows[2], value));
    precise float error = h.enlarged * NEWTON_ROUNDING;
    if (!(error < LOST && largest_of(start) < FAR)) return IN_DOUBT;
    Map map;
    map.c = vec3[8](corner, h.c[0], h.c[1], h.c[2], h.c[3], h.c[4], h.c[5], h.c[6]);
    precise float twist = (largest_of(h.c[3]) + largest_of(h.c[4])) + largest_of(h.c[5]);
    precise float bend = fma(3.0 * FAR, largest_of(h.c[6]), twist);
    map.bend = bend;
    float margin;
    bool certain;
    vec3 x = newton(HEXAHEDRON, map, start, error, margin, certain);
    precise vec3 y = 1.0 - x;
    float least = min(min(min(x.x, x.y), x.z), min(min(y.x, y.y), y.z));
    precise vec4 across = vec4(y.x, x.x, x.x, y.x) * vec4(y.y, y.y, x.y, x.y);
    precise vec4 low = across * y.z;
    precise vec4 high = across * x.z;
    weights = Weights(low, high);
    return verdict_of(certain, least, margin);
}

// The same of a wedge or a pyramid.
uint tapered_verdict(uint kind, vec3 corners[8], vec3 at, out Weights weights) {
    weights = Weights(vec4(0.0), vec4(0.0));
    vec3 p[8];
    float size = 0.0;
    for (int k = 0; k < 8; ++k) {
        precise vec3 apart = corners[k] - at;
        p[k] = apart;
        size = max(size, largest_of(apart));
    }
    float scale = scale_of(size);
    if (scale == 0.0) return IN_DOUBT;
    for (int k = 0; k < 8; ++k) p[k] *= scale;
    Map map;
    float margin;
    bool certain;
    precise vec3 a = p[1] - p[0];
    if (kind == WEDGE) {
        precise vec3 b = p[2] - p[0];
        precise vec3 rise = p[3] - p[0];
        precise vec3 twist_r = (p[4] - p[3]) - a;
        precise vec3 twist_s = (p[5] - p[3]) - b;
        map.c = vec3[8](p[0], a, b, rise, twist_r, twist_s, vec3(0.0), vec3(0.0));
        map.bend = largest_of(twist_r) + largest_of(twist_s);
        vec3 x = newton(kind, map, vec3(1.0 / 3.0, 1.0 / 3.0, 0.5), 0.0, margin, certain);
        precise float q = (1.0 - x.x) - x.y;
        precise float u = 1.0 - x.z;
        float least = min(min(x.x, x.y), min(q, min(x.z, u)));
        precise vec3 low = vec3(q, x.x, x.y) * u;
        precise vec3 high = vec3(q, x.x, x.y) * x.z;
        weights = Weights(vec4(low, high.x), vec4(high.yz, 0.0, 0.0));
        // The third of the triangle's coordinates is off by as much as the other two together.
        return verdict_of(certain, least, 2.0 * margin);
    }
    precise vec3 corner = p[0] - p[4];
    precise vec3 b = p[3] - p[0];
    precise vec3 bend = (p[2] - p[3]) - a;
    float base = max(max(largest_of(corner), largest_of(a)), largest_of(b));
    float distance = largest_of(p[4]) / base;
    precise vec3 target = p[4] * (-1.0 / distance);
    map.c = vec3[8](corner, a, b, bend, target, vec3(0.0), vec3(0.0), vec3(0.0));
    map.bend = largest_of(bend);
    float enlarged;
    vec3 start = solve(
        add_scaled(corner, -0.25, bend),
        add_scaled(a, 0.5, bend),
        add_scaled(b, 0.5, bend),
        target,
        enlarged
    );
    float error = NEWTON_ROUNDING * enlarged;
    vec3 x = newton(kind, map, start, error, margin, certain);
    precise vec2 r = x.yz / x.x;
    precise vec2 q = 1.0 - r;
    precise float height = x.x * distance;
    precise float rest = 1.0 - height;
    float least = min(min(min(r.x, r.y), min(q.x, q.y)), rest);
    // Base coordinates are quotients: of numbers up to FAR, by one that is not small.
    margin *= 4.0 / x.x;
    certain = certain && x.x > 1.0 / 16.0 && distance > NEAR_APEX && abs(r.x) < 2.0
        && abs(r.y) < 2.0 && height < 4.0;
    precise vec4 low = (vec4(q.x, r.x, r.x, q.x) * vec4(q.y, q.y, r.y, r.y)) * height;
    weights = Weights(low, vec4(rest, 0.0, 0.0, 0.0));
    return verdict_of(certain, least, margin);
}

#include "mesh_exact.glsl"

// Steps towards a plane between a place and a hexahedron.
const int HULL_STEPS = 8;

// Whether a place lies outside of the hull of a hexahedron's corners by more than rounding: a plane through it
// has all of them behind. Steps towards the hull's nearest point find it, by way of the corners that are
// farthest ahead (von Neumann's algorithm). Outside Newton's method may end nowhere from all of its starts,
// and finding that out takes `f64` so long that other subgroups wait.
bool outside_hull(vec3 corners[8], vec3 extent, vec3 at) {
    vec3 nearest = vec3(0.0);
    for (int k = 0; k < 8; ++k) nearest += 0.125 * (corners[k] - at);
    for (int i = 0; i < HULL_STEPS; ++i) {
        float most = -LARGEST;
        vec3 corner = nearest;
        [[unroll]] for (int k = 0; k < 8; ++k) {
            vec3 seen = corners[k] - at;
            float ahead = -dot_of(nearest, seen);
            corner = ahead > most ? seen : corner;
            most = max(most, ahead);
        }
        if (most < -1e-4 * dot_of(abs(nearest), extent)) return true;
        vec3 side = corner - nearest;
        nearest += clamp(-dot_of(nearest, side) / dot_of(side, side), 0.0, 1.0) * side;
    }
    return false;
}

// Whether a cell accepts a place, and the weights of its corners there.
bool other_accepts(Submesh part, Other other, vec3 at, out Weights weights) {
    vec3 corners[8];
    [[unroll]] for (uint k = 0; k < 8; ++k) corners[k] = vertex_at(part, other.vertices[k]);
    vec3 lo = corners[0];
    vec3 hi = corners[0];
    [[unroll]] for (int k = 1; k < 8; ++k) {
        lo = min(lo, corners[k]);
        hi = max(hi, corners[k]);
    }
    weights = Weights(vec4(0.0), vec4(0.0));
    if (!in_box(at, lo, hi)) return false;
    bool is_hexahedron = other.kind == HEXAHEDRON;
    uint verdict = is_hexahedron
        ? hexahedron_verdict(hexahedron_of(corners), at, weights)
        : tapered_verdict(other.kind, corners, at, weights);
    if (verdict != IN_DOUBT) return verdict == INSIDE;
    if (is_hexahedron && outside_hull(corners, hi - lo, at)) return false;
    return other_exactly(part, other, at, weights);
}
