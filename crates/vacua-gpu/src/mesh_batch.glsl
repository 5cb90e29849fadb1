// Batches of cells that a subgroup tries: a cell a lane is set up, then each ray tries those that it may
// meet, by where they are along the beam's axes. Lanes hand each other what they know of their cells:
// shared memory is what limits how many subgroups a device runs at a time.

// Cells of a batch.
const uint BATCH = LANES < 32 ? LANES : 32;

// A tetrahedron: planes seen from the beam's middle, volume, bound on rounding.
struct Tet {
    vec3 cd;
    float u;
    vec3 db;
    float v;
    vec3 bc;
    float w;
    float whole;
    float bound;
    uint primitive;
    uint node;
};

// Planes around another cell by pairs: normals, and where they are, seen from the beam's middle.
struct Planes {
    vec3 normals[3];
    vec3 first;
    vec3 last;
};

// The tetrahedron of another lane.
Tet tet_of(Tet own, uint lane) {
    Tet t;
    t.cd = subgroupShuffle(own.cd, lane);
    t.u = subgroupShuffle(own.u, lane);
    t.db = subgroupShuffle(own.db, lane);
    t.v = subgroupShuffle(own.v, lane);
    t.bc = subgroupShuffle(own.bc, lane);
    t.w = subgroupShuffle(own.w, lane);
    t.whole = subgroupShuffle(own.whole, lane);
    t.bound = subgroupShuffle(own.bound, lane);
    t.primitive = subgroupShuffle(own.primitive, lane);
    t.node = CELL_DATA ? subgroupShuffle(own.node, lane) : 0;
    return t;
}

// Planes around another lane's cell.
Planes planes_of(Planes own, uint lane) {
    Planes p;
    [[unroll]] for (uint a = 0; a < 3; ++a) p.normals[a] = subgroupShuffle(own.normals[a], lane);
    p.first = subgroupShuffle(own.first, lane);
    p.last = subgroupShuffle(own.last, lane);
    return p;
}

// Cells of the batch that the lane's ray may meet, as bits; `range` is where the lane's own cell is along
// the beam's first two axes, if the beam meets it.
uint cells_of_ray(bool is_met, vec4 range) {
    uint columns = tile_columns();
    uint lane = gl_SubgroupInvocationID;
    uint in_column = 0;
    for (uint c = 0; c < columns; ++c) {
        vec2 rays = subgroupShuffle(ray_column, c);
        uint met = subgroupBallot(is_met && range.x <= rays.y && range.z >= rays.x).x;
        if (c == lane % columns) in_column = met;
    }
    uint in_row = 0;
    for (uint r = 0; r < LANES / columns; ++r) {
        vec2 rays = subgroupShuffle(ray_row, r * columns);
        uint met = subgroupBallot(is_met && range.y <= rays.y && range.w >= rays.x).x;
        if (r == lane / columns) in_row = met;
    }
    return in_column & in_row;
}

// Sets up the lane's tetrahedron if the beam meets it; whether it does, and where it is along the beam's
// axes.
bool set_up_tet(Mesh mesh, Submesh part, uint primitive, inout Tet tet, out vec4 range) {
    Beam beam = this_beam();
    range = vec4(0.0);
    uvec4 vertices;
    vec3 corners[4];
    tet_corners(part, primitive, vertices, corners);
    vec3 seen[4];
    for (int k = 0; k < 4; ++k) seen[k] = corners[k] - beam.middle;
    vec3 lo = min(min(seen[0], seen[1]), min(seen[2], seen[3]));
    vec3 hi = max(max(seen[0], seen[1]), max(seen[2], seen[3]));
    vec3 around = max(max(abs(lo), abs(hi)), beam.extent);
    float more = 1e-6 * (around.x + around.y + around.z);
    bool is_met = all(lessThanEqual(lo, beam.extent + more))
        && all(greaterThanEqual(hi, -beam.extent - more));
    for (int a = 0; a < 3; ++a) {
        vec4 at = vec4(
            dot(beam.axes[a], seen[0]),
            dot(beam.axes[a], seen[1]),
            dot(beam.axes[a], seen[2]),
            dot(beam.axes[a], seen[3])
        );
        float least = min(min(at.x, at.y), min(at.z, at.w)) - more;
        float most = max(max(at.x, at.y), max(at.z, at.w)) + more;
        is_met = is_met && least <= beam.half_sides[a] && most >= -beam.half_sides[a];
        if (a < 2) {
            range[a] = least;
            range[a + 2] = most;
        }
    }
    if (!is_met) return false;
    float scale = mesh.slack.w;
    vec3 a = corners[0];
    precise vec3 b = (corners[1] - a) * scale;
    precise vec3 c = (corners[2] - a) * scale;
    precise vec3 d = (corners[3] - a) * scale;
    vec3 cd = cross_of(c, d);
    vec3 db = cross_of(d, b);
    vec3 bc = cross_of(b, c);
    float whole = dot_of(b, cd);
    float turn = whole < 0.0 ? -scale : scale;
    cd *= turn;
    db *= turn;
    bc *= turn;
    whole = abs(whole);
    vec3 sum = cd + db + bc;
    around *= scale;
    vec3 sides = (hi - lo) * scale;
    vec3 steepest = max(max(abs(cd), abs(db)), max(abs(bc), abs(sum)));
    float bound = dot(around, sides.yzx * sides.zxy) * BEAM_ROUNDING + SLOPE_ROUNDING
        + 2.0 * dot(steepest, mesh.slack.xyz);
    // Volumes at the middle of the beam.
    float u = -dot_of(cd, seen[0]);
    float v = -dot_of(db, seen[0]);
    float w = -dot_of(bc, seen[0]);
    float last = whole - ((u + v) + w);
    float most = min(
        min(u + reach_of(beam, cd), v + reach_of(beam, db)),
        min(w + reach_of(beam, bc), last + reach_of(beam, sum))
    );
    if (most < -bound) return false;
    tet = Tet(cd, u, db, v, bc, w, whole, bound, primitive, 0);
    return true;
}

// Steps of a segment: at all samples between `lo` and `hi` some volumes may not be negative, at all
// between `sure_lo` and `sure_hi` they are positive.
struct Span {
    float lo;
    float hi;
    float sure_lo;
    float sure_hi;
};

// Narrows a span by a volume that grows by `slope` a step and is off by up to `bound`.
void narrow(inout Span span, float volume, float slope, float bound) {
    float rise = abs(slope) < LEAST_SLOPE ? -LEAST_SLOPE : slope;
    float inverse = 1.0 / rise;
    float root = -volume * inverse;
    float margin = bound * abs(inverse);
    if (rise > 0.0) {
        span.lo = max(span.lo, root - margin);
        span.sure_lo = max(span.sure_lo, root + margin);
    } else {
        span.hi = min(span.hi, root + margin);
        span.sure_hi = min(span.sure_hi, root - margin);
    }
}

// Which of the lane's samples a tetrahedron may hold, and which it holds for sure.
uvec2 samples_of_tet(Tet tet, Segment segment, vec3 start, vec3 step, uint open) {
    float u = dot_of(tet.cd, start) + tet.u;
    float v = dot_of(tet.db, start) + tet.v;
    float w = dot_of(tet.bc, start) + tet.w;
    float du = dot_of(tet.cd, step);
    float dv = dot_of(tet.db, step);
    float dw = dot_of(tet.bc, step);
    Span span = Span(0.0, segment.steps, 0.0, segment.steps);
    narrow(span, u, du, tet.bound);
    narrow(span, v, dv, tet.bound);
    narrow(span, w, dw, tet.bound);
    narrow(span, tet.whole - ((u + v) + w), -((du + dv) + dw), tet.bound);
    // Roots are rounded too, by far less than a thousandth.
    float from = max(ceil(span.lo - 1e-3), 0.0);
    float to = min(floor(span.hi + 1e-3), segment.steps);
    float sure_from = max(ceil(span.sure_lo + 1e-3), 0.0);
    float sure_to = min(floor(span.sure_hi - 1e-3), segment.steps);
    uint may = samples_between(segment, from, to, open);
    uint sure = samples_between(segment, sure_from, sure_to, may);
    return uvec2(may, sure);
}

// Which of the lane's samples may lie between the planes around another cell.
uint samples_of_other(Planes planes, Segment segment, vec3 start, vec3 step, uint open) {
    float lo = 0.0;
    float hi = segment.steps;
    [[unroll]] for (uint a = 0; a < 3; ++a) {
        vec3 normal = planes.normals[a];
        float first = planes.first[a];
        float last = planes.last[a];
        float at = dot_of(normal, start);
        float rate = dot_of(normal, step);
        // By less than what planes are apart for rounding.
        float least = 1e-10 * (last - first);
        float inverse = 1.0 / (abs(rate) < least ? least : rate);
        float p = (first - at) * inverse;
        float q = (last - at) * inverse;
        lo = max(lo, min(p, q));
        hi = min(hi, max(p, q));
    }
    float from = max(ceil(lo - 1e-3), 0.0);
    float to = min(floor(hi + 1e-3), segment.steps);
    return samples_between(segment, from, to, open);
}

// Sets up the lane's other cell if the beam meets it; whether it does, and where it is along the beam's axes.
bool set_up_other(Mesh mesh, Submesh part, uint primitive, inout Planes planes, out vec4 range) {
    Beam beam = this_beam();
    Other other = other_at(part, primitive >> 1);
    vec3 corners[8];
    [[unroll]] for (uint k = 0; k < 8; ++k) corners[k] = vertex_at(part, other.vertices[k]);
    vec3 lo = corners[0];
    vec3 hi = corners[0];
    vec3 least = vec3(LARGEST);
    vec3 most = vec3(-LARGEST);
    [[unroll]] for (uint k = 0; k < 8; ++k) {
        lo = min(lo, corners[k]);
        hi = max(hi, corners[k]);
        vec3 seen = corners[k] - beam.middle;
        vec3 at = vec3(
            dot(beam.axes[0], seen), dot(beam.axes[1], seen), dot(beam.axes[2], seen)
        );
        least = min(least, at);
        most = max(most, at);
    }
    lo -= beam.middle;
    hi -= beam.middle;
    vec3 around = max(max(abs(lo), abs(hi)), beam.extent);
    float more = 1e-6 * (around.x + around.y + around.z);
    least -= more;
    most += more;
    range = vec4(least.xy, most.xy);
    bool is_met = all(lessThanEqual(lo, beam.extent + more))
        && all(greaterThanEqual(hi, -beam.extent - more))
        && all(lessThanEqual(least, beam.half_sides))
        && all(greaterThanEqual(most, -beam.half_sides));
    if (!is_met) return false;
    planes.normals = vec3[3](vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));
    if (other.kind == HEXAHEDRON) {
        vec3 rows[3] = hexahedron_of(corners).rows;
        float size = largest_of(rows[0]) + largest_of(rows[1]) + largest_of(rows[2]);
        if (size < 1e6) planes.normals = rows;
    }
    // Between planes across its edges, as cells lie within the hull of their corners.
    [[unroll]] for (uint a = 0; a < 3; ++a) {
        float first = LARGEST;
        float last = -LARGEST;
        [[unroll]] for (uint k = 0; k < 8; ++k) {
            float at = dot_of(planes.normals[a], corners[k] - beam.middle);
            first = min(first, at);
            last = max(last, at);
        }
        float margin = dot(abs(planes.normals[a]), 1e-6 * around + 2.0 * mesh.slack.xyz);
        planes.first[a] = first - margin;
        planes.last[a] = last + margin;
    }
    return true;
}
