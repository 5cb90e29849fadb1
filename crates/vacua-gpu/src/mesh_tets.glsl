// Tetrahedra: whether they accept a place, and the weights of their corners there. Twins of
// `vacua_pack`'s tetrahedron (in `f64`) and of its vector code (in `f32`, with a bound on rounding):
// what `f32` leaves in doubt, `f64` decides.

// Bound on the rounding of a volume, in units of the volume of the box around the cell.
const float TET_ROUNDING = 1024.0 / 16777216.0;
// Where products of scaled differences may be subnormal and lose digits.
const float TET_SMALLEST = 1.2e-37;
// A tetrahedron this flat, box volume by volume, gets its weights in `f64`.
const float TET_FLAT = 32.0;
// Rounding of a determinant in `f64`, in units of the sum of the magnitudes of its terms.
const double TET_EXACT_ROUNDING = 16.0LF * 2.220446049250313e-16LF;

vec3 cross_of(vec3 a, vec3 b) {
    precise vec3 found = fma(a.yzx, b.zxy, -(a.zxy * b.yzx));
    return found;
}

float dot_of(vec3 a, vec3 b) {
    precise float found = fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
    return found;
}

bool in_box(vec3 place, vec3 lo, vec3 hi) {
    return all(lessThanEqual(lo, place)) && all(lessThanEqual(place, hi));
}

// Six times the signed volume between the origin and a triangle, and a bound on its rounding.
void exact_volume(dvec3 a, dvec3 b, dvec3 c, out double volume, out double rounding) {
    dvec3 size = abs(a);
    precise double x = b.y * c.z - b.z * c.y;
    precise double y = b.z * c.x - b.x * c.z;
    precise double z = b.x * c.y - b.y * c.x;
    precise double sum = a.x * x + a.y * y + a.z * z;
    precise double magnitude = size.x * (abs(b.y * c.z) + abs(b.z * c.y))
        + size.y * (abs(b.z * c.x) + abs(b.x * c.z))
        + size.z * (abs(b.x * c.y) + abs(b.y * c.x));
    volume = sum;
    precise double bound = TET_EXACT_ROUNDING * magnitude;
    rounding = bound;
}

// Whether a tetrahedron accepts a place, and the weights of its corners there.
bool tet_exactly(vec3 place, vec3 corners[4], out vec4 weights) {
    weights = vec4(1.0, 0.0, 0.0, 0.0);
    vec3 lo = min(min(corners[0], corners[1]), min(corners[2], corners[3]));
    vec3 hi = max(max(corners[0], corners[1]), max(corners[2], corners[3]));
    if (!in_box(place, lo, hi)) return false;
    dvec3 at = dvec3(place);
    dvec3 a = dvec3(corners[0]) - at;
    dvec3 b = dvec3(corners[1]) - at;
    dvec3 c = dvec3(corners[2]) - at;
    dvec3 d = dvec3(corners[3]) - at;
    double v[4];
    double r[4];
    exact_volume(b, d, c, v[0], r[0]);
    exact_volume(a, c, d, v[1], r[1]);
    exact_volume(a, d, b, v[2], r[2]);
    exact_volume(a, b, c, v[3], r[3]);
    precise double whole = ((v[0] + v[1]) + v[2]) + v[3];
    precise double rounding = ((r[0] + r[1]) + r[2]) + r[3];
    // Flat, as far as can be told; an inverted one is as good as any.
    if (!(abs(whole) > rounding)) return false;
    double turn = whole < 0.0LF ? -1.0LF : 1.0LF;
    for (int i = 0; i < 4; ++i) {
        double volume = v[i] * turn;
        if (volume < -r[i]) return false;
        v[i] = max(volume, 0.0LF);
    }
    precise double sum = ((v[0] + v[1]) + v[2]) + v[3];
    weights = vec4(v[0] / sum, v[1] / sum, v[2] / sum, v[3] / sum);
    return true;
}

// What is told of a place and a cell.
const uint OUTSIDE = 0;
const uint INSIDE = 1;
const uint IN_DOUBT = 2;

void tet_corners(Submesh part, uint primitive, out uvec4 vertices, out vec3 corners[4]) {
    vertices = tet_vertices(part, primitive);
    for (int i = 0; i < 4; ++i) corners[i] = vertex_at(part, vertices[i]);
}

// What volumes in `f32` tell of a tetrahedron and a place: `least` is the smallest that the place makes
// with the faces, positive inside, `bound` bounds its rounding.
uint tet_verdict(vec3 place, vec3 corners[4], float scale, out float least, out float bound) {
    vec3 a = corners[0];
    vec3 lo = min(min(a, corners[1]), min(corners[2], corners[3]));
    vec3 hi = max(max(a, corners[1]), max(corners[2], corners[3]));
    least = -LARGEST;
    bound = 0.0;
    if (!in_box(place, lo, hi)) return OUTSIDE;
    precise vec3 b = (corners[1] - a) * scale;
    precise vec3 c = (corners[2] - a) * scale;
    precise vec3 d = (corners[3] - a) * scale;
    precise vec3 p = (place - a) * scale;
    precise vec3 side = (hi - lo) * scale;
    vec3 cd = cross_of(c, d);
    float whole = dot_of(b, cd);
    float turn = whole < 0.0 ? -1.0 : 1.0;
    float u = turn * dot_of(p, cd);
    float v = turn * dot_of(p, cross_of(d, b));
    float w = turn * dot_of(p, cross_of(b, c));
    precise float last = abs(whole) - ((u + v) + w);
    least = min(min(u, v), min(w, last));
    bound = side.x * side.y * side.z * TET_ROUNDING + TET_SMALLEST;
    if (abs(whole) > 4.0 * bound && abs(least) > bound) return least > 0.0 ? INSIDE : OUTSIDE;
    return IN_DOUBT;
}

// Whether a tetrahedron accepts a place.
bool tet_accepts(vec3 place, vec3 corners[4], float scale) {
    float least;
    float bound;
    uint verdict = tet_verdict(place, corners, scale, least, bound);
    if (verdict != IN_DOUBT) return verdict == INSIDE;
    vec4 weights;
    return tet_exactly(place, corners, weights);
}

// The weights of the corners of a tetrahedron that accepts a place.
vec4 tet_weights(vec3 place, vec3 corners[4], float scale) {
    vec3 a = corners[0];
    precise vec3 b = (corners[1] - a) * scale;
    precise vec3 c = (corners[2] - a) * scale;
    precise vec3 d = (corners[3] - a) * scale;
    precise vec3 p = (place - a) * scale;
    vec3 cd = cross_of(c, d);
    float whole = dot_of(b, cd);
    vec3 largest = max(max(abs(b), abs(c)), abs(d));
    bool is_round = largest.x * largest.y * largest.z < abs(whole) * TET_FLAT && abs(whole) > 1e-30;
    if (is_round) {
        precise float inverse = 1.0 / whole;
        precise vec3 rest = vec3(
            dot_of(p, cd),
            dot_of(p, cross_of(d, b)),
            dot_of(p, cross_of(b, c))
        ) * inverse;
        rest = clamp(rest, 0.0, 1.0);
        precise float first = 1.0 - ((rest.x + rest.y) + rest.z);
        return vec4(first, rest);
    }
    vec4 weights;
    tet_exactly(place, corners, weights);
    return weights;
}
