// Pyramids, wedges and hexahedra in `f64`: what `f32` leaves in doubt is decided by the very operations of
// `vacua_pack`'s scalar code.

// Newton's steps, the size of the last one, where it is given up, and how far outside still is inside.
const int EXACT_STEPS = 24;
const double EXACT_LAST_STEP = 1e-7LF;
const double EXACT_FAR = 1e3LF;
const double TOLERANCE = 1e-9LF;

double exact_largest(dvec3 a) {
    return max(max(abs(a.x), abs(a.y)), abs(a.z));
}

// The same operations in the same order as the scalar code, none of them contracted.
dvec3 exact_sum(dvec3 a, double s, dvec3 b) {
    precise dvec3 sum = a + s * b;
    return sum;
}

dvec3 exact_cross(dvec3 a, dvec3 b) {
    precise dvec3 found = a.yzx * b.zxy - a.zxy * b.yzx;
    return found;
}

double exact_dot(dvec3 a, dvec3 b) {
    precise double sum = a.x * b.x + a.y * b.y + a.z * b.z;
    return sum;
}

bool exact_solve(dvec3 a, dvec3 b, dvec3 c, dvec3 right, out dvec3 x) {
    dvec3 bc = exact_cross(b, c);
    double determinant = exact_dot(a, bc);
    precise dvec3 found = dvec3(
        exact_dot(right, bc),
        exact_dot(right, exact_cross(c, a)),
        exact_dot(right, exact_cross(a, b))
    ) / determinant;
    x = found;
    return exact_largest(x) < 1e308LF;
}

// Value and derivatives of a map, coefficients as in `Map`.
void exact_map(
    uint kind,
    dvec3 c[8],
    dvec3 x,
    out dvec3 value,
    out dvec3 dx,
    out dvec3 dy,
    out dvec3 dz
) {
    if (kind == HEXAHEDRON) {
        dx = exact_sum(exact_sum(exact_sum(c[1], x.y, c[4]), x.z, c[6]), x.y * x.z, c[7]);
        dy = exact_sum(exact_sum(exact_sum(c[2], x.z, c[5]), x.x, c[4]), x.x * x.z, c[7]);
        dz = exact_sum(exact_sum(exact_sum(c[3], x.x, c[6]), x.y, c[5]), x.x * x.y, c[7]);
        dvec3 plane =
            exact_sum(exact_sum(exact_sum(c[0], x.y, c[2]), x.z, c[3]), x.y * x.z, c[5]);
        value = exact_sum(plane, x.x, dx);
    } else if (kind == WEDGE) {
        dx = exact_sum(c[1], x.z, c[4]);
        dy = exact_sum(c[2], x.z, c[5]);
        dz = exact_sum(exact_sum(c[3], x.x, c[4]), x.y, c[5]);
        value = exact_sum(exact_sum(exact_sum(c[0], x.z, c[3]), x.x, dx), x.y, dy);
    } else {
        precise double r = x.y / x.x;
        precise double s = x.z / x.x;
        precise dvec3 sum = x.x * c[0];
        sum = exact_sum(exact_sum(sum, x.y, c[1]), x.z, c[2]);
        sum = exact_sum(sum, x.y * s, c[3]);
        precise dvec3 apart = sum - c[4];
        value = apart;
        dx = exact_sum(c[0], -r * s, c[3]);
        dy = exact_sum(c[1], s, c[3]);
        dz = exact_sum(c[2], r, c[3]);
    }
}

// Newton's method from a start.
bool exact_newton(uint kind, dvec3 c[8], dvec3 start, out dvec3 x) {
    x = start;
    for (int i = 0; i < EXACT_STEPS; ++i) {
        dvec3 value, dx, dy, dz, step;
        exact_map(kind, c, x, value, dx, dy, dz);
        if (!exact_solve(dx, dy, dz, value, step)) return false;
        precise dvec3 next = x - step;
        x = next;
        if (exact_largest(step) < EXACT_LAST_STEP) return true;
        if (exact_largest(x) > EXACT_FAR) return false;
    }
    return false;
}

bool is_near(double x) {
    return x >= -TOLERANCE && x <= 1.0LF + TOLERANCE;
}

// A number of starts of the scalar code.
dvec3 start_of(uint kind, int k) {
    int corner = k - 1;
    if (kind == WEDGE) {
        if (k == 0) return dvec3(1.0LF / 3.0LF, 1.0LF / 3.0LF, 0.5LF);
        int of_triangle = corner % 3;
        return dvec3(
            of_triangle == 1 ? 0.8LF : 0.1LF,
            of_triangle == 2 ? 0.8LF : 0.1LF,
            corner < 3 ? 0.1LF : 0.9LF
        );
    }
    // Of a pyramid, places of its base.
    if (k == 0) return dvec3(0.5LF);
    return dvec3(
        (corner & 1) != 0 ? 0.9LF : 0.1LF,
        (corner & 2) != 0 ? 0.9LF : 0.1LF,
        (corner & 4) != 0 ? 0.9LF : 0.1LF
    );
}

// Whether local coordinates are those of the element, and the weights of its corners then.
bool exact_weights(uint kind, dvec3 x, double distance, out Weights weights) {
    weights = Weights(vec4(0.0), vec4(0.0));
    if (kind == WEDGE) {
        precise double rest = 1.0LF - x.x - x.y;
        bool is_inside = x.x >= -TOLERANCE && x.y >= -TOLERANCE && rest >= -TOLERANCE;
        if (!(is_inside && is_near(x.z))) return false;
        dvec3 base = max(dvec3(rest, x.xy), dvec3(0.0LF));
        base /= base.x + base.y + base.z;
        double t = clamp(x.z, 0.0LF, 1.0LF);
        vec3 low = vec3(base * (1.0LF - t));
        vec3 high = vec3(base * t);
        weights = Weights(vec4(low, high.x), vec4(high.yz, 0.0, 0.0));
        return true;
    }
    double w = 1.0LF;
    if (kind == PYRAMID) {
        precise dvec2 base = x.yz / x.x;
        precise double height = x.x * distance;
        w = height;
        if (!(w >= 0.0LF)) return false;
        x = dvec3(base, w);
    }
    if (!(is_near(x.x) && is_near(x.y) && is_near(x.z))) return false;
    x = clamp(x, dvec3(0.0LF), dvec3(1.0LF));
    dvec2 u = 1.0LF - x.xy;
    dvec4 base = dvec4(u.x * u.y, x.x * u.y, x.x * x.y, u.x * x.y);
    if (kind == PYRAMID) {
        weights = Weights(vec4(base * x.z), vec4(1.0LF - x.z, 0.0, 0.0, 0.0));
    } else {
        weights = Weights(vec4(base * (1.0LF - x.z)), vec4(base * x.z));
    }
    return true;
}

// What `f64` says of a cell and a place.
bool other_exactly(Submesh part, Other other, vec3 at, out Weights weights) {
    uint kind = other.kind;
    dvec3 from = dvec3(at);
    dvec3 p[8];
    for (uint k = 0; k < 8; ++k) p[k] = dvec3(vertex_at(part, other.vertices[k])) - from;
    dvec3 c[8];
    dvec3 a = p[1] - p[0];
    double distance = 1.0LF;
    weights = Weights(vec4(0.0), vec4(1.0, 0.0, 0.0, 0.0));
    if (kind == HEXAHEDRON) {
        dvec3 b = p[3] - p[0];
        precise dvec3 rs = p[2] - p[3] - a;
        precise dvec3 st = p[7] - p[4] - b;
        precise dvec3 tr = p[5] - p[4] - a;
        precise dvec3 rst = (p[6] - p[7]) - (p[5] - p[4]) - rs;
        c = dvec3[8](p[0], a, b, p[4] - p[0], rs, st, tr, rst);
    } else if (kind == WEDGE) {
        dvec3 b = p[2] - p[0];
        precise dvec3 twist_r = p[4] - p[3] - a;
        precise dvec3 twist_s = p[5] - p[3] - b;
        c = dvec3[8](p[0], a, b, p[3] - p[0], twist_r, twist_s, p[0], p[0]);
    } else {
        dvec3 corner = p[0] - p[4];
        dvec3 b = p[3] - p[0];
        precise dvec3 bend = p[2] - p[3] - a;
        dvec3 from_apex = -p[4];
        double size = max(max(exact_largest(corner), exact_largest(a)), exact_largest(b));
        precise double apart = exact_largest(from_apex) / size;
        distance = apart;
        if (distance == 0.0LF) {
            dvec3 x;
            return exact_solve(corner, a, b, from_apex, x);
        }
        precise dvec3 target = (1.0LF / distance) * from_apex;
        c = dvec3[8](corner, a, b, bend, target, p[0], p[0], p[0]);
    }
    int starts = kind == HEXAHEDRON ? 9 : kind == WEDGE ? 7 : 5;
    for (int k = 0; k < starts; ++k) {
        dvec3 start = start_of(kind, k);
        dvec3 x;
        if (kind == PYRAMID) {
            // A guess for u·v/w that is right at this place of the base.
            dvec3 by_w = exact_sum(c[0], -start.x * start.y, c[3]);
            dvec3 by_u = exact_sum(c[1], start.y, c[3]);
            dvec3 by_v = exact_sum(c[2], start.x, c[3]);
            if (!exact_solve(by_w, by_u, by_v, c[4], start)) continue;
        }
        if (!exact_newton(kind, c, start, x)) continue;
        if (exact_weights(kind, x, distance, weights)) return true;
        if (k == 0) return false;
    }
    return false;
}
