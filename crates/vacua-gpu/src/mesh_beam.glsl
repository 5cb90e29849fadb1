// The beam of a subgroup's samples: the box around them along its own axes, and whether something meets it.

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

// Subgroups see tiles of the picture about as wide as high, columns fastest.
uint tile_columns() {
    return 1u << ((uint(findMSB(LANES)) + 1) / 2);
}

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
    vec3 margin = vec3(dot(abs(side), more), dot(abs(up), more), dot(abs(ahead), more));
    half_sides += margin;
    vec2 column = vec2(LARGEST, -LARGEST);
    vec2 row = column;
    if (is_there) {
        vec3 lo_along = min(along_p, along_q) - shift - margin;
        vec3 hi_along = max(along_p, along_q) - shift + margin;
        column = vec2(lo_along.x, hi_along.x);
        row = vec2(lo_along.y, hi_along.y);
    }
    uint columns = tile_columns();
    for (uint apart = columns; apart < LANES; apart <<= 1) {
        vec2 other = subgroupShuffleXor(column, apart);
        column = vec2(min(column.x, other.x), max(column.y, other.y));
    }
    for (uint apart = 1; apart < columns; apart <<= 1) {
        vec2 other = subgroupShuffleXor(row, apart);
        row = vec2(min(row.x, other.x), max(row.y, other.y));
    }
    ray_column = column;
    ray_row = row;
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
