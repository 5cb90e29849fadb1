// The beam of a subgroup's samples, and what cells hold of them: which cells the beam meets, which
// samples of a lane a cell may hold, and which it holds for sure.

// Where the segments of all lanes are.
struct Beam {
    // Middle of the box along the beam; places are seen from here.
    vec3 middle;
    // A box along the mesh's axes about the same middle: half its sides.
    vec3 extent;
    // The beam's own axes, and half the sides of the box along them.
    vec3 axes[3];
    vec3 half_sides;
};

// Least of a number among lanes: as integers of the same order, which hardware reduces at once.
ivec3 ordered(vec3 x) {
    ivec3 bits = floatBitsToInt(x);
    return bits ^ (bits >> 31 & 0x7fffffff);
}

vec3 unordered(ivec3 bits) {
    return intBitsToFloat(bits ^ (bits >> 31 & 0x7fffffff));
}

vec3 least_of_all(vec3 x) {
    ivec3 bits = ordered(x);
    return unordered(ivec3(subgroupMin(bits.x), subgroupMin(bits.y), subgroupMin(bits.z)));
}

vec3 most_of_all(vec3 x) {
    ivec3 bits = ordered(x);
    return unordered(ivec3(subgroupMax(bits.x), subgroupMax(bits.y), subgroupMax(bits.z)));
}

float largest_side(vec3 a) {
    return max(max(abs(a.x), abs(a.y)), abs(a.z));
}

// Puts the beam around all segments where `this_beam` finds it. Its axes need not be exact, as all is
// measured along them.
void set_beam(Segment segment, vec3 slack) {
    bool is_there = segment.mask != 0;
    uint leader = subgroupBallotFindLSB(subgroupBallot(is_there));
    vec3 ahead = subgroupShuffle(forward(), leader);
    vec3 side = sideways();
    ahead /= max(largest_side(ahead), 1e-37);
    side /= max(largest_side(side), 1e-37);
    ahead *= inversesqrt(max(dot(ahead, ahead), 1e-6));
    side -= ahead * dot(ahead, side);
    if (dot(side, side) < 1e-4) {
        side = abs(ahead.x) < 0.7 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0);
        side -= ahead * dot(ahead, side);
    }
    side *= inversesqrt(dot(side, side));
    vec3 up = cross(ahead, side);
    vec3 none = vec3(LARGEST);
    vec3 lo = least_of_all(is_there ? min(segment.first, segment.last) : none);
    vec3 hi = most_of_all(is_there ? max(segment.first, segment.last) : -none);
    vec3 centre = 0.5 * lo + 0.5 * hi;
    vec3 p = segment.first - centre;
    vec3 q = segment.last - centre;
    vec3 along_p = vec3(dot(side, p), dot(up, p), dot(ahead, p));
    vec3 along_q = vec3(dot(side, q), dot(up, q), dot(ahead, q));
    vec3 from = least_of_all(is_there ? min(along_p, along_q) : none);
    vec3 to = most_of_all(is_there ? max(along_p, along_q) : -none);
    vec3 shift = 0.5 * from + 0.5 * to;
    vec3 move = side * shift.x + up * shift.y + ahead * shift.z;
    vec3 half_sides = 0.5 * (to - from);
    // Much wider than rounding needs.
    vec3 more = 2.0 * slack + 1e-5 * (half_sides.x + half_sides.y + half_sides.z);
    vec3 extent = 0.5 * (hi - lo) + abs(move) + more;
    half_sides += vec3(dot(abs(side), more), dot(abs(up), more), dot(abs(ahead), more));
    if (gl_SubgroupInvocationID == 0) {
        uint quad = gl_SubgroupID * BEAM_QUADS;
        beams[quad] = vec4(centre + move, 0.0);
        beams[quad + 1] = vec4(extent, 0.0);
        beams[quad + 2] = vec4(side, 0.0);
        beams[quad + 3] = vec4(up, 0.0);
        beams[quad + 4] = vec4(ahead, 0.0);
        beams[quad + 5] = vec4(half_sides, 0.0);
    }
    together();
}

vec3 middle_of_beam() {
    return beams[gl_SubgroupID * BEAM_QUADS].xyz;
}

Beam this_beam() {
    uint quad = gl_SubgroupID * BEAM_QUADS;
    return Beam(
        beams[quad].xyz,
        beams[quad + 1].xyz,
        vec3[3](beams[quad + 2].xyz, beams[quad + 3].xyz, beams[quad + 4].xyz),
        beams[quad + 5].xyz
    );
}

// Whether the beam may meet a box along the mesh's axes.
bool meets(Beam beam, vec3 lo, vec3 hi) {
    vec3 apart = (0.5 * lo + 0.5 * hi) - beam.middle;
    vec3 sides = (0.5 * hi - 0.5 * lo) * 1.00001;
    bool is_met = all(lessThanEqual(abs(apart), sides + beam.extent));
    for (int a = 0; a < 3; ++a) {
        float reach = dot(abs(beam.axes[a]), sides) + beam.half_sides[a];
        is_met = is_met && abs(dot(beam.axes[a], apart)) <= reach;
    }
    return is_met;
}

// Which samples of a block lie between two steps of a segment.
uint samples_between(Segment segment, float from, float to, uint open) {
    if (!(from <= to)) return 0;
    uint a = segment.begin + uint(from);
    uint b = segment.begin + uint(to);
    return open & ((2u << b) - (1u << a));
}

// How far a plane's volume reaches over the beam's box, to each side of its middle.
float reach_of(Beam beam, vec3 normal) {
    return beam.half_sides.x * abs(dot(normal, beam.axes[0]))
        + beam.half_sides.y * abs(dot(normal, beam.axes[1]))
        + beam.half_sides.z * abs(dot(normal, beam.axes[2]));
}

// Sets up a tetrahedron in a place of the batch if the beam meets it; whether it does.
bool set_up_tet(Mesh mesh, Submesh part, uint primitive, out vec4 quads[TET_QUADS]) {
    Beam beam = this_beam();
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
        float reach = beam.half_sides[a] + more;
        is_met = is_met && min(min(at.x, at.y), min(at.z, at.w)) <= reach
            && max(max(at.x, at.y), max(at.z, at.w)) >= -reach;
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
    quads[0] = vec4(cd, u);
    quads[1] = vec4(db, v);
    quads[2] = vec4(bc, w);
    quads[3] = vec4(whole, bound, uintBitsToFloat(primitive), 0.0);
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

// Which of the lane's samples a tetrahedron of the batch may hold, and which it holds for sure.
uvec2 samples_of_tet(uint slot, Segment segment, vec3 start, vec3 step, uint open) {
    uint quad = (gl_SubgroupID * LANES + slot) * TET_QUADS;
    vec4 cd = tets[quad];
    vec4 db = tets[quad + 1];
    vec4 bc = tets[quad + 2];
    vec2 rest = tets[quad + 3].xy;
    float bound = rest.y;
    float u = dot_of(cd.xyz, start) + cd.w;
    float v = dot_of(db.xyz, start) + db.w;
    float w = dot_of(bc.xyz, start) + bc.w;
    float du = dot_of(cd.xyz, step);
    float dv = dot_of(db.xyz, step);
    float dw = dot_of(bc.xyz, step);
    Span span = Span(0.0, segment.steps, 0.0, segment.steps);
    narrow(span, u, du, bound);
    narrow(span, v, dv, bound);
    narrow(span, w, dw, bound);
    narrow(span, rest.x - ((u + v) + w), -((du + dv) + dw), bound);
    // Roots are rounded too, by far less than a thousandth.
    float from = max(ceil(span.lo - 1e-3), 0.0);
    float to = min(floor(span.hi + 1e-3), segment.steps);
    float sure_from = max(ceil(span.sure_lo + 1e-3), 0.0);
    float sure_to = min(floor(span.sure_hi - 1e-3), segment.steps);
    uint may = samples_between(segment, from, to, open);
    uint sure = samples_between(segment, sure_from, sure_to, may);
    return uvec2(may, sure);
}

// Which of the lane's samples may lie in the box of another cell of the batch.
uint samples_of_box(uint slot, Segment segment, vec3 start, vec3 step_inverse, uint open) {
    uint quad = (gl_SubgroupID * LANES + slot) * TET_QUADS;
    vec3 p = (tets[quad].xyz - start) * step_inverse;
    vec3 q = (tets[quad + 1].xyz - start) * step_inverse;
    vec3 near = min(p, q);
    vec3 far = max(p, q);
    float lo = max(max(near.x, near.y), max(near.z, 0.0));
    float hi = min(min(far.x, far.y), min(far.z, segment.steps));
    float from = max(ceil(lo - 1e-3), 0.0);
    float to = min(floor(hi + 1e-3), segment.steps);
    return samples_between(segment, from, to, open);
}
