// The cells of blocks of samples of all rays of a subgroup, found together.
//
// The rays are neighbours and the blocks lie side by side: a beam. The subgroup goes through the tree
// once for all of them, a child a lane; then takes the cells of the leaves that the beam meets, sets
// up one a lane (planes of tetrahedra, boxes of other cells), leaves out what the beam misses, and
// each ray tries all that is left: which of its samples a tetrahedron holds is the intersection of
// four half lines. Pairs of other cells and samples in their boxes, and of tetrahedra and samples that
// rounding leaves in doubt, are collected until there is one for each lane; then all lanes invert
// maps.
//
// What is found does not depend on who searches along: each sample's cell is the one with the lowest
// packed index of all that accept its place, which `f32` decides where its rounding allows and `f64`
// elsewhere, as everywhere.
//
// Who includes this defines `place_of`, and where `found` is kept that is read by.

#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require

// Lanes of a subgroup, at least 8; subgroups of a workgroup.
layout(constant_id = 40) const uint LANES = 32;
layout(constant_id = 41) const uint SUBGROUPS = 2;
layout(local_size_x_id = 42) in;

// Nodes and tetrahedra that wait, at most; a node alone can give 264 of these.
const uint STACK = 256;
const uint QUEUE = 512;
// Quads of words that a tetrahedron takes while it is tried.
const uint TET_QUADS = 5;
// Bound on the rounding of volumes along rays, in units of the volume around beam and cell.
const float BEAM_ROUNDING = 4096.0 / 16777216.0;
// Set with a pair's place in `found` where its cell is a tetrahedron.
const uint IS_TET = 0x80000000u;
// Set with a sub-mesh's number where `found_value` holds the value.
const uint HAS_VALUE = 0x80000000u;
// Set with it where there is a cell but no value in it.
const uint IS_OTHER = 0x40000000u;
const uint IS_VALID = 0x20000000u;
const uint PART_BITS = 0x1fffffffu;

shared uint stack[SUBGROUPS * STACK];
shared uint queue[SUBGROUPS * QUEUE];
shared uint queue_node[CELL_DATA ? SUBGROUPS * QUEUE : 1];
shared uvec2 others[SUBGROUPS * LANES * 4];
shared vec4 tets[SUBGROUPS * LANES * TET_QUADS];
shared vec4 pair_places[SUBGROUPS * LANES * 2];
shared uvec2 pair_cells[SUBGROUPS * LANES * 2];
// For each sample of each lane: primitive, sub-mesh with the bits above, node, value.
shared uint found[SUBGROUPS * LANES * BLOCK];
shared uint found_part[SUBGROUPS * LANES * BLOCK];
shared uint found_node[CELL_DATA ? SUBGROUPS * LANES * BLOCK : 1];
shared float found_value[SUBGROUPS * LANES * BLOCK];

// Where sample `i` of the lane's block is, in the mesh's own space.
vec3 place_of(uint i);

// What a lane looks for: a line through its samples, and which of a block they are.
struct Segment {
    vec3 first;
    vec3 last;
    uint begin;
    // Steps from first to last.
    float steps;
    uint mask;
};

// Where the segments of all lanes are.
struct Beam {
    // The middle line, and how far along each axis any sample is from it.
    vec3 start;
    vec3 along;
    vec3 radius;
    // A box around all.
    vec3 centre;
    vec3 extent;
};

void together() {
    subgroupMemoryBarrierShared();
    subgroupBarrier();
}

uint found_slot(uint lane, uint i) {
    return (gl_SubgroupID * BLOCK + i) * LANES + lane;
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

Beam beam_of(Segment segment, vec3 slack) {
    bool is_there = segment.mask != 0;
    vec3 none = vec3(LARGEST);
    vec3 lo0 = least_of_all(is_there ? segment.first : none);
    vec3 hi0 = most_of_all(is_there ? segment.first : -none);
    vec3 lo1 = least_of_all(is_there ? segment.last : none);
    vec3 hi1 = most_of_all(is_there ? segment.last : -none);
    Beam beam;
    beam.start = 0.5 * lo0 + 0.5 * hi0;
    beam.along = (0.5 * lo1 + 0.5 * hi1) - beam.start;
    vec3 lo = min(lo0, lo1);
    vec3 hi = max(hi0, hi1);
    beam.centre = 0.5 * lo + 0.5 * hi;
    beam.extent = 0.5 * (hi - lo) + 2.0 * slack;
    beam.radius = 0.5 * max(hi0 - lo0, hi1 - lo1) + 1e-5 * beam.extent + 2.0 * slack;
    return beam;
}

// One over the way along each axis.
vec3 inverse_of(vec3 along, float least) {
    vec3 way = mix(along, vec3(least), lessThan(abs(along), vec3(least)));
    return 1.0 / way;
}

// Whether a line, widened by a box, meets another box.
bool meets(vec3 start, vec3 inverse, vec3 radius, vec3 lo, vec3 hi) {
    vec3 p = ((lo - radius) - start) * inverse;
    vec3 q = ((hi + radius) - start) * inverse;
    vec3 near = min(p, q);
    vec3 far = max(p, q);
    return max(max(near.x, near.y), max(near.z, 0.0)) <= min(min(far.x, far.y), min(far.z, 1.0));
}

// Which samples of a block lie between two steps of a segment.
uint samples_between(Segment segment, float lo, float hi, uint open) {
    float from = ceil(max(lo, 0.0) - 1e-3);
    float to = floor(min(hi, segment.steps) + 1e-3);
    if (!(from <= to)) return 0;
    uint a = segment.begin + uint(max(from, 0.0));
    uint b = segment.begin + uint(min(to, segment.steps));
    return open & ((2u << b) - (1u << a));
}

// Sets up a tetrahedron in a place of the batch if the beam meets it; whether it does.
bool set_up_tet(Mesh mesh, Submesh part, Beam beam, vec3 inverse, uint primitive, out vec4 quads[TET_QUADS]) {
    uvec4 vertices;
    vec3 corners[4];
    tet_corners(part, primitive, vertices, corners);
    vec3 lo = min(min(corners[0], corners[1]), min(corners[2], corners[3]));
    vec3 hi = max(max(corners[0], corners[1]), max(corners[2], corners[3]));
    if (!meets(beam.start, inverse, beam.radius, lo, hi)) return false;
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
    vec3 side = (hi - lo) * scale;
    float bound = side.x * side.y * side.z * TET_ROUNDING + TET_SMALLEST;
    vec3 around = max(max(abs(lo - beam.centre), abs(hi - beam.centre)), beam.extent) * scale;
    vec3 steepest = max(max(abs(cd), abs(db)), abs(bc));
    float far_bound = around.x * around.y * around.z * BEAM_ROUNDING + TET_SMALLEST
        + 4.0 * dot(steepest, mesh.slack.xyz);
    // Volumes at both ends of the beam's middle line, and how much they may grow across it.
    vec3 p = beam.start - a;
    vec3 at_start = vec3(dot(p, cd), dot(p, db), dot(p, bc));
    vec3 change = vec3(dot(beam.along, cd), dot(beam.along, db), dot(beam.along, bc));
    vec3 growth = vec3(dot(beam.radius, abs(cd)), dot(beam.radius, abs(db)), dot(beam.radius, abs(bc)));
    vec3 most = at_start + max(change, vec3(0.0)) + growth;
    vec3 sum = cd + db + bc;
    float last = whole - (at_start.x + at_start.y + at_start.z)
        + max(-(change.x + change.y + change.z), 0.0) + dot(beam.radius, abs(sum));
    if (min(min(most.x, most.y), min(most.z, last)) < -far_bound) return false;
    vec3 from = a - beam.centre;
    // Of a cell that may be flat nothing is certain.
    bool is_flat = !(whole > 4.0 * bound);
    quads[0] = vec4(cd, -dot_of(cd, from));
    quads[1] = vec4(db, -dot_of(db, from));
    quads[2] = vec4(bc, -dot_of(bc, from));
    quads[3] = vec4(a, whole);
    quads[4] = vec4(far_bound, is_flat ? LARGEST : bound, uintBitsToFloat(primitive), 0.0);
    return true;
}

// Narrows the steps at which a volume that grows by `slope` a step is not negative.
void narrow(float volume, float slope, inout float lo, inout float hi) {
    float rise = slope == 0.0 ? -1e-30 : slope;
    float root = -volume / rise;
    if (rise > 0.0) lo = max(lo, root);
    else hi = min(hi, root);
}

// Which of the lane's samples a tetrahedron of the batch may hold.
uint samples_of_tet(uint slot, Segment segment, vec3 start, vec3 step, uint open) {
    uint quad = (gl_SubgroupID * LANES + slot) * TET_QUADS;
    vec4 cd = tets[quad];
    vec4 db = tets[quad + 1];
    vec4 bc = tets[quad + 2];
    float whole = tets[quad + 3].w;
    float bound = tets[quad + 4].x;
    float u = dot_of(cd.xyz, start) + cd.w;
    float v = dot_of(db.xyz, start) + db.w;
    float w = dot_of(bc.xyz, start) + bc.w;
    float du = dot_of(cd.xyz, step);
    float dv = dot_of(db.xyz, step);
    float dw = dot_of(bc.xyz, step);
    float lo = 0.0;
    float hi = segment.steps;
    narrow(u + bound, du, lo, hi);
    narrow(v + bound, dv, lo, hi);
    narrow(w + bound, dw, lo, hi);
    narrow((whole - ((u + v) + w)) + bound, -((du + dv) + dw), lo, hi);
    return samples_between(segment, lo, hi, open);
}

// Which of the lane's samples may lie in the box of another cell of the batch.
uint samples_of_box(uint slot, Segment segment, vec3 step_inverse, vec3 slack, uint open) {
    uint quad = (gl_SubgroupID * LANES + slot) * TET_QUADS;
    vec3 p = ((tets[quad].xyz - slack) - segment.first) * step_inverse;
    vec3 q = ((tets[quad + 1].xyz + slack) - segment.first) * step_inverse;
    vec3 near = min(p, q);
    vec3 far = max(p, q);
    float from = max(max(near.x, near.y), near.z);
    float to = min(min(far.x, far.y), far.z);
    return samples_between(segment, from, to, open);
}

// Tries a cell of the batch on a sample; true if that is left to be judged.
bool try_cell(uint number, uint slot, bool is_tet, vec3 place, uint found_at, out uvec2 cell) {
    uint quad = (gl_SubgroupID * LANES + slot) * TET_QUADS;
    if (!is_tet) {
        vec4 lo = tets[quad];
        vec4 hi = tets[quad + 1];
        cell = uvec2(floatBitsToUint(lo.w), floatBitsToUint(hi.w));
        return cell.x < found[found_at] && in_box(place, lo.xyz, hi.xyz);
    }
    vec4 corner = tets[quad + 3];
    vec4 rest = tets[quad + 4];
    cell = uvec2(floatBitsToUint(rest.z), floatBitsToUint(rest.w));
    if (cell.x >= found[found_at]) return false;
    precise vec3 p = place - corner.xyz;
    float x = dot_of(p, tets[quad].xyz);
    float y = dot_of(p, tets[quad + 1].xyz);
    float z = dot_of(p, tets[quad + 2].xyz);
    precise float last = corner.w - ((x + y) + z);
    float least = min(min(x, y), min(z, last));
    if (least > rest.y) {
        found[found_at] = cell.x;
        found_part[found_at] = number;
        if (CELL_DATA) found_node[found_at] = cell.y;
        return false;
    }
    return !(least < -rest.y);
}

// Settles the last `count` pairs that wait, one a lane.
void judge_pairs(Submesh part, uint number, uint first, uint count) {
    uint lane = gl_SubgroupInvocationID;
    uint slot = 0;
    uvec2 cell = uvec2(NO_CELL, 0);
    uint kind = TETRAHEDRON;
    Weights weights;
    bool is_accepted = false;
    if (lane < count) {
        uint pair = gl_SubgroupID * LANES * 2 + first + lane;
        vec4 place = pair_places[pair];
        cell = pair_cells[pair];
        bool is_tet = (floatBitsToUint(place.w) & IS_TET) != 0;
        slot = floatBitsToUint(place.w) & ~IS_TET;
        if (cell.x < found[slot]) {
            if (HAS_TETS && is_tet) {
                uvec4 vertices;
                vec3 corners[4];
                vec4 of_tet;
                tet_corners(part, cell.x, vertices, corners);
                is_accepted = tet_exactly(place.xyz, corners, of_tet);
            } else if (HAS_OTHERS) {
                is_accepted = other_accepts(part, cell.x, place.xyz, kind, weights);
            }
        }
    }
    if (is_accepted) atomicMin(found[slot], cell.x);
    together();
    if (is_accepted && found[slot] == cell.x) {
        uint bits = number;
        if (HAS_OTHERS && kind != TETRAHEDRON) {
            float value = 0.0;
            bool is_valid = false;
            if (!CELL_DATA) is_valid = other_value(part, cell.x, kind, weights, value);
            found_value[slot] = value;
            bits |= IS_OTHER | (CELL_DATA ? 0 : HAS_VALUE) | (is_valid ? IS_VALID : 0);
        }
        found_part[slot] = bits;
        if (CELL_DATA) found_node[slot] = cell.y;
    }
    together();
}

// Searches one sub-mesh for the cells of samples that are still `open`.
void search_part(Mesh mesh, uint number, Segment segment, Beam beam, uint open) {
    Submesh part = mesh.submeshes.submesh[number];
    uint lane = gl_SubgroupInvocationID;
    uint octet = lane >> 3;
    uint child_number = lane & 7u;
    uint stack_base = gl_SubgroupID * STACK;
    uint queue_base = gl_SubgroupID * QUEUE;
    uint others_base = gl_SubgroupID * LANES * 4;
    uint pairs_base = gl_SubgroupID * LANES * 2;
    // The beam in sixteenths of the grid, where boxes are exact; wider than rounding needs.
    vec3 grid_start = grid_place(part, beam.start);
    vec3 grid_along = beam.along * part.sixteenths.xyz;
    vec3 grid_inverse = inverse_of(grid_along, 1e-6);
    vec3 grid_radius = beam.radius * part.sixteenths.xyz + 2.0
        + 4e-7 * (abs(grid_start) + abs(grid_along));
    float least = 1e-6 * max(max(beam.extent.x, beam.extent.y), beam.extent.z);
    vec3 inverse = inverse_of(beam.along, max(least, 1e-37));
    vec3 start = segment.first - beam.centre;
    vec3 step = segment.steps > 0.0 ? (segment.last - segment.first) / segment.steps : vec3(0.0);
    vec3 step_inverse = inverse_of(step, max(1e-6 * least, 1e-37));
    // What waits: nodes, tetrahedra, other cells, pairs; and a batch of cells that are being tried.
    uint waiting = 1;
    uint queued = 0;
    uint num_others = 0;
    uint num_pairs = 0;
    uint batch = 0;
    uint tried = 0;
    bool is_of_tets = false;
    // Samples that are left of the cell that is being tried.
    uint left = 0;
    if (lane == 0) stack[stack_base] = 0;
    together();
    while (true) {
        bool is_last = waiting + queued + num_others == 0 && tried == batch;
        if (num_pairs >= LANES || (is_last && num_pairs > 0)) {
            uint count = min(num_pairs, LANES);
            num_pairs -= count;
            judge_pairs(part, number, num_pairs, count);
            continue;
        }
        if (is_last) break;
        if (tried < batch) {
            while (tried < batch && num_pairs < LANES) {
                if (!subgroupAny(left != 0)) {
                    left = is_of_tets
                        ? samples_of_tet(tried, segment, start, step, open)
                        : samples_of_box(tried, segment, step_inverse, 2.0 * mesh.slack.xyz, open);
                }
                while (num_pairs < LANES && subgroupAny(left != 0)) {
                    bool is_pair = false;
                    vec3 place = vec3(0.0);
                    uint found_at = 0;
                    uvec2 cell = uvec2(0);
                    if (left != 0) {
                        uint i = uint(findLSB(left));
                        left &= left - 1;
                        place = place_of(i);
                        found_at = found_slot(lane, i);
                        is_pair = try_cell(number, tried, is_of_tets, place, found_at, cell);
                    }
                    uvec4 pairs = subgroupBallot(is_pair);
                    if (is_pair) {
                        uint pair = pairs_base + num_pairs + subgroupBallotExclusiveBitCount(pairs);
                        uint bits = found_at | (is_of_tets ? IS_TET : 0);
                        pair_places[pair] = vec4(place, uintBitsToFloat(bits));
                        pair_cells[pair] = cell;
                    }
                    num_pairs += subgroupBallotBitCount(pairs);
                }
                if (!subgroupAny(left != 0)) ++tried;
            }
            together();
            continue;
        }
        if (HAS_TETS && (queued >= LANES || (waiting == 0 && queued > 0))) {
            uint count = min(queued, LANES);
            queued -= count;
            vec4 quads[TET_QUADS];
            bool is_met = false;
            if (lane < count) {
                uint primitive = queue[queue_base + queued + lane];
                is_met = set_up_tet(mesh, part, beam, inverse, primitive, quads);
                if (CELL_DATA) quads[4].w = uintBitsToFloat(queue_node[queue_base + queued + lane]);
            }
            uvec4 met = subgroupBallot(is_met);
            if (is_met) {
                uint slot = subgroupBallotExclusiveBitCount(met);
                uint quad = (gl_SubgroupID * LANES + slot) * TET_QUADS;
                for (uint q = 0; q < TET_QUADS; ++q) tets[quad + q] = quads[q];
            }
            batch = subgroupBallotBitCount(met);
            tried = 0;
            is_of_tets = true;
            together();
            continue;
        }
        if (HAS_OTHERS && (num_others >= LANES || (waiting == 0 && num_others > 0))) {
            uint count = min(num_others, LANES);
            num_others -= count;
            bool is_met = false;
            vec3 lo = vec3(LARGEST);
            vec3 hi = vec3(-LARGEST);
            uvec2 cell = uvec2(0);
            if (lane < count) {
                cell = others[others_base + num_others + lane];
                uint place = cell.x >> 1;
                uint corners = num_corners(kind_of_other(part, place));
                for (uint k = 0; k < corners; ++k) {
                    vec3 corner = vertex_at(part, other_vertex(part, place, k));
                    lo = min(lo, corner);
                    hi = max(hi, corner);
                }
                is_met = meets(beam.start, inverse, beam.radius, lo, hi);
            }
            uvec4 met = subgroupBallot(is_met);
            if (is_met) {
                uint slot = subgroupBallotExclusiveBitCount(met);
                uint quad = (gl_SubgroupID * LANES + slot) * TET_QUADS;
                tets[quad] = vec4(lo, uintBitsToFloat(cell.x));
                tets[quad + 1] = vec4(hi, uintBitsToFloat(cell.y));
            }
            batch = subgroupBallotBitCount(met);
            tried = 0;
            is_of_tets = false;
            together();
            continue;
        }
        // A child a lane, of as many nodes as there are octets.
        uint take = min(waiting, LANES / 8);
        if (waiting + LANES > STACK) take = 1;
        bool is_there = octet < take;
        uint node = is_there ? stack[stack_base + waiting - 1 - octet] : 0;
        waiting -= take;
        together();
        Child child;
        child.counts = 0;
        child.is_inner = false;
        bool is_hit = false;
        uint first_child = 0;
        uint first_index = 0;
        if (is_there) {
            child = child_at(part, node, child_number);
            first_child = first_child_of(part, node);
            first_index = first_index_of(part, node);
            is_hit = (child.counts != 0 || child.is_inner)
                && meets(grid_start, grid_inverse, grid_radius, child.lo, child.hi);
        }
        uvec4 inner = subgroupBallot(child.is_inner);
        uint inner_before = bitCount(
            inner[octet >> 2] >> (8 * (octet & 3u)) & ((1u << child_number) - 1)
        );
        uint below = first_child + inner_before;
        uint words = leaf_indices(child.counts);
        uint words_before = subgroupExclusiveAdd(words);
        first_index += words_before - subgroupShuffle(words_before, lane & ~7u);
        bool is_leaf = is_hit && child.counts != 0;
        uint num_tets = HAS_TETS && is_leaf ? leaf_tets(child.counts) : 0;
        uint tets_before = subgroupExclusiveAdd(num_tets);
        // Nodes whose cells find no room wait a little longer; the first always finds some.
        uint tets_of_octets = subgroupShuffle(tets_before + num_tets, lane | 7u);
        bool has_room = queued + tets_of_octets <= QUEUE;
        is_hit = is_hit && has_room;
        is_leaf = is_leaf && has_room;
        bool is_put_back = is_there && !has_room && child_number == 0;
        bool is_pushed = is_put_back || (is_hit && child.is_inner);
        uvec4 pushed = subgroupBallot(is_pushed);
        if (is_pushed) {
            uint place = waiting + subgroupBallotExclusiveBitCount(pushed);
            if (place < STACK) stack[stack_base + place] = is_put_back ? node : below;
            else mesh.overflow = 1;
        }
        waiting = min(waiting + subgroupBallotBitCount(pushed), STACK);
        uint singles = child.counts & 3u;
        if (is_leaf) {
            uint place = queue_base + queued + tets_before;
            for (uint i = 0; i < num_tets; ++i) {
                uint pair = i - singles;
                queue[place + i] = i < singles
                    ? 2 * (first_index + 4 * i)
                    : 2 * (first_index + 4 * singles + 5 * (pair >> 1)) + (pair & 1u);
                if (CELL_DATA) queue_node[place + i] = node;
            }
        }
        queued += subgroupMax(has_room ? tets_before + num_tets : 0);
        if (HAS_OTHERS && part.has_others != 0) {
            uint count = is_leaf ? child.counts >> 6 : 0;
            uint place = num_others + subgroupExclusiveAdd(count);
            first_index += 4 * singles + 5 * (child.counts >> 2 & 15u);
            for (uint i = 0; i < count; ++i) {
                others[others_base + place + i] = uvec2(2 * (first_index + 8 * i), node);
            }
            num_others += subgroupAdd(count);
        }
        together();
    }
}

// Fills `found` in for the samples of all lanes' segments.
void search(Mesh mesh, Segment segment) {
    uint lane = gl_SubgroupInvocationID;
    for (uint i = 0; i < BLOCK; ++i) found[found_slot(lane, i)] = NO_CELL;
    together();
    if (!subgroupAny(segment.mask != 0)) return;
    Beam beam = beam_of(segment, mesh.slack.xyz);
    float least = 1e-6 * max(max(beam.extent.x, beam.extent.y), beam.extent.z);
    vec3 inverse = inverse_of(beam.along, max(least, 1e-37));
    uint open = segment.mask;
    for (uint first = 0; first < mesh.num_submeshes; first += LANES) {
        uint number = first + lane;
        bool is_met = false;
        if (number < mesh.num_submeshes) {
            vec3 lo = mesh.submeshes.submesh[number].lo.xyz;
            vec3 hi = mesh.submeshes.submesh[number].hi.xyz;
            is_met = meets(beam.start, inverse, beam.radius, lo, hi);
        }
        // In order: a cell of an earlier sub-mesh comes first.
        while (true) {
            uint next = subgroupMin(is_met ? number : NO_CELL);
            if (next == NO_CELL) break;
            if (next == number) is_met = false;
            search_part(mesh, next, segment, beam, open);
            for (uint i = 0; i < BLOCK; ++i) {
                if (found[found_slot(lane, i)] != NO_CELL) open &= ~(1u << i);
            }
            if (!subgroupAny(open != 0)) return;
        }
    }
}
