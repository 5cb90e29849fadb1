// Values and gradients in the cells of a mesh.

// Values at the corners of a cell, and what comes of them: never outside their range, whatever the
// rounding; differences to the first keep small signals on large offsets, and constants, exact.
struct Mixture {
    float first;
    float lo;
    float hi;
    float sum;
    bool is_valid;
};

Mixture mixture(float first) {
    return Mixture(first, first, first, first, is_number(first));
}

void mix_in(inout Mixture m, float value, float weight) {
    m.lo = min(m.lo, value);
    m.hi = max(m.hi, value);
    precise float sum = fma(weight, value - m.first, m.sum);
    m.sum = sum;
    m.is_valid = m.is_valid && is_number(value);
}

// The value in a tetrahedron that accepts a place; false if there is none.
bool tet_value(Mesh mesh, Submesh part, uint primitive, vec3 place, out float value) {
    uvec4 vertices;
    vec3 corners[4];
    tet_corners(part, primitive, vertices, corners);
    vec4 weights = tet_weights(place, corners, mesh.slack.w);
    Mixture m = mixture(stored_value(part, vertices.x));
    mix_in(m, stored_value(part, vertices.y), weights.y);
    mix_in(m, stored_value(part, vertices.z), weights.z);
    mix_in(m, stored_value(part, vertices.w), weights.w);
    value = clamp(m.sum, m.lo, m.hi);
    return m.is_valid;
}

// Values at the corners of another cell; past its own that of the last one, which has no weight there.
void other_values(Submesh part, Other other, out float values[8]) {
    [[unroll]] for (uint k = 0; k < 8; ++k) values[k] = stored_value(part, other.vertices[k]);
}

// The value in another cell, from the weights of its corners; false if there is none.
bool other_value(float values[8], Weights weights, out float value) {
    Mixture m = mixture(values[0]);
    [[unroll]] for (uint k = 1; k < 8; ++k) {
        mix_in(m, values[k], k < 4 ? weights.low[k] : weights.high[k - 4]);
    }
    value = clamp(m.sum, m.lo, m.hi);
    return m.is_valid;
}

// The value in a cell that accepts a place; false if there is none.
bool value_in_cell(Mesh mesh, Submesh part, Cell cell, vec3 place, out float value) {
    if (CELL_DATA) {
        value = cell_value(part, cell.node, cell.primitive);
        return is_number(value);
    }
    if (!HAS_OTHERS || (HAS_TETS && !cell.is_other)) {
        return tet_value(mesh, part, cell.primitive, place, value);
    }
    Other other = other_of(part, cell.primitive);
    Weights weights;
    other_accepts(part, other, place, weights);
    float values[8];
    other_values(part, other, values);
    return other_value(values, weights, value);
}

// How the weight of a corner changes with each local coordinate, from the weights of all. `precise`, as all
// that gradients are made of, so that every shader that lights surfaces makes the same bits.
vec3 slope_of(uint kind, uint k, Weights w) {
    precise vec3 slope;
    if (kind == TETRAHEDRON) {
        return k == 0 ? vec3(-1.0) : vec3(k == 1, k == 2, k == 3);
    }
    if (kind == WEDGE) {
        precise float t = (w.low.w + w.high.x) + w.high.y;
        precise float r = w.low.y + w.high.x;
        precise float s = w.low.z + w.high.y;
        bool up = k >= 3;
        uint of_triangle = up ? k - 3 : k;
        precise float along = up ? t : 1.0 - t;
        float side = up ? 1.0 : -1.0;
        if (of_triangle == 0) {
            slope = vec3(-along, -along, side * (1.0 - r - s));
        } else {
            slope = of_triangle == 1 ? vec3(along, 0.0, side * r) : vec3(0.0, along, side * s);
        }
        return slope;
    }
    bool in_r = (k & 3u) == 1 || (k & 3u) == 2;
    bool in_s = (k & 2u) != 0;
    float dr = in_r ? 1.0 : -1.0;
    float ds = in_s ? 1.0 : -1.0;
    if (kind == PYRAMID) {
        // By r and s per unit of height, by which the columns are then scaled alike.
        precise float height = max((w.low.x + w.low.y) + (w.low.z + w.low.w), 1.17549435e-38);
        precise float r = (w.low.y + w.low.z) / height;
        precise float s = (w.low.z + w.low.w) / height;
        if (k == 4) return vec3(0.0, 0.0, 1.0);
        precise float in_x = in_r ? r : 1.0 - r;
        precise float in_y = in_s ? s : 1.0 - s;
        slope = vec3(dr * in_y, ds * in_x, -in_x * in_y);
        return slope;
    }
    precise float r = (w.low.y + w.low.z) + (w.high.y + w.high.z);
    precise float s = (w.low.z + w.low.w) + (w.high.z + w.high.w);
    precise float t = (w.high.x + w.high.y) + (w.high.z + w.high.w);
    precise float in_x = in_r ? r : 1.0 - r;
    precise float in_y = in_s ? s : 1.0 - s;
    bool in_t = k >= 4;
    precise float in_z = in_t ? t : 1.0 - t;
    slope = vec3(dr * in_y * in_z, ds * in_x * in_z, (in_t ? 1.0 : -1.0) * in_x * in_y);
    return slope;
}

// The gradient in the mesh's own space, in a cell that accepts a place; 0 where its map is singular.
vec3 gradient_in_cell(Mesh mesh, Submesh part, Cell cell, vec3 place) {
    if (CELL_DATA) return vec3(0.0);
    uint kind = TETRAHEDRON;
    Weights weights = Weights(vec4(0.0), vec4(0.0));
    uvec4 vertices = uvec4(0);
    Other other;
    bool is_other = HAS_OTHERS && (!HAS_TETS || cell.is_other);
    if (is_other) {
        other = other_of(part, cell.primitive);
        kind = other.kind;
        other_accepts(part, other, place, weights);
        vertices.x = other.vertices[0];
    } else {
        vertices = tet_vertices(part, cell.primitive);
    }
    vec3 first = vertex_at(part, vertices.x);
    float first_value = stored_value(part, vertices.x);
    precise vec3 a = vec3(0.0);
    precise vec3 b = vec3(0.0);
    precise vec3 c = vec3(0.0);
    precise vec3 by = vec3(0.0);
    uint corners = num_corners(kind);
    float scale = mesh.slack.w;
    for (uint k = 1; k < corners; ++k) {
        // Differences to the first corner: the slopes of all corners are 0 in sum.
        uint vertex = is_other ? other.vertices[k] : vertices[k];
        vec3 slope = slope_of(kind, k, weights);
        precise vec3 apart = (vertex_at(part, vertex) - first) * scale;
        precise float value = stored_value(part, vertex) - first_value;
        by = fma(slope, vec3(value), by);
        a = fma(slope.xxx, apart, a);
        b = fma(slope.yyy, apart, b);
        c = fma(slope.zzz, apart, c);
    }
    vec3 bc = cross_of(b, c);
    precise vec3 sum =
        fma(by.xxx, bc, fma(by.yyy, cross_of(c, a), by.z * cross_of(a, b)));
    precise vec3 gradient = sum * (scale / dot_of(a, bc));
    bool is_finite = is_number(gradient.x) && is_number(gradient.y) && is_number(gradient.z);
    return is_finite ? gradient : vec3(0.0);
}
