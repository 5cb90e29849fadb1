// The cells of blocks of samples of all rays of a subgroup, found together.
//
// The rays are neighbours and the blocks lie side by side: a beam, in a box along its own axes. The
// subgroup goes through the tree once for all of them, a child a lane; then takes the cells of the
// leaves that the beam meets, sets up one a lane (planes of tetrahedra, boxes of other cells), leaves
// out what the beam misses, and each ray tries all that is left: which of its samples a tetrahedron
// holds is the intersection of four half lines. Rounding is bounded, so that most samples are certain;
// pairs of cells and samples that are not wait until there is one for each lane, then all lanes judge
// them. Of other cells a box says which samples they may hold: a lane keeps one such cell a sample
// until the end, when most samples have one, and only what is more than one becomes a pair at once.
//
// What is found does not depend on who searches along: each sample's cell is the one with the lowest
// packed index of all that accept its place, which `f32` decides where its rounding allows and `f64`
// elsewhere, as everywhere.
//
// Who includes this defines `place_of`, `forward` and `sideways`, and reads `found`.

#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#extension GL_EXT_control_flow_attributes : require

// Lanes of a subgroup, at least 8; subgroups of a workgroup.
layout(constant_id = 40) const uint LANES = 32;
layout(constant_id = 41) const uint SUBGROUPS = 2;
layout(local_size_x_id = 42) in;

// Nodes and tetrahedra that wait, at most; a node alone can give 264 of these.
const uint STACK = 256;
const uint QUEUE = 272 + 2 * LANES;
// Quads of words that a tetrahedron takes while it is tried, and a beam.
const uint TET_QUADS = 4;
const uint BEAM_QUADS = 6;
// Bound on the rounding of volumes along rays. A normal's component is a difference of products of the
// cell's other two sides; with the way along its axis from the beam's middle and summed over the axes,
// these products are rounded some seventy times a volume, and the last volume is what is left by three.
const float BEAM_ROUNDING = 256.0 / 16777216.0;
// Slopes of volumes along rays, smaller than which none is told from; and what that takes at most.
const float LEAST_SLOPE = 1e-30;
const float SLOPE_ROUNDING = 1e-28;
// Set with a pair's place in `found` where its cell is a tetrahedron.
const uint IS_TET = 0x80000000u;
// Set with a sub-mesh's number where `found_value` holds the value.
const uint HAS_VALUE = 0x80000000u;
// Set with it where there is a cell but no value in it.
const uint IS_OTHER = 0x40000000u;
const uint IS_VALID = 0x20000000u;
const uint PART_BITS = 0x1fffffffu;

shared uint stack[SUBGROUPS * STACK];
shared uint queue[HAS_TETS ? SUBGROUPS * QUEUE : 1];
shared uint queue_node[CELL_DATA && HAS_TETS ? SUBGROUPS * QUEUE : 1];
shared uvec2 others[HAS_OTHERS ? SUBGROUPS * LANES * 4 : 1];
shared vec4 tets[SUBGROUPS * LANES * TET_QUADS];
shared vec4 beams[SUBGROUPS * BEAM_QUADS];
shared vec4 pair_places[SUBGROUPS * LANES * 2];
shared uvec2 pair_cells[SUBGROUPS * LANES * 2];
// For each sample of each lane: primitive, sub-mesh with the bits above, node, value.
shared uint found[SUBGROUPS * LANES * BLOCK];
shared uint found_part[SUBGROUPS * LANES * BLOCK];
shared uint found_node[CELL_DATA ? SUBGROUPS * LANES * BLOCK : 1];
shared float found_value[HAS_OTHERS ? SUBGROUPS * LANES * BLOCK : 1];

// Where sample `i` of the lane's block is, in the mesh's own space.
vec3 place_of(uint i);
// Where the lane's ray goes, and how it differs from its neighbours, roughly.
vec3 forward();
vec3 sideways();

void together() {
    subgroupMemoryBarrierShared();
    subgroupBarrier();
}

uint found_slot(uint lane, uint i) {
    return (gl_SubgroupID * BLOCK + i) * LANES + lane;
}

#include "mesh_beam.glsl"

// Settles the last `count` pairs that wait, one a lane.
void judge_pairs(Mesh mesh, Submesh part, uint number, uint first, uint count) {
    uint lane = gl_SubgroupInvocationID;
    uint slot = 0;
    uvec2 cell = uvec2(NO_CELL, 0);
    bool is_tet = HAS_TETS;
    Other other;
    Weights weights;
    bool is_accepted = false;
    if (lane < count) {
        uint pair = gl_SubgroupID * LANES * 2 + first + lane;
        vec4 place = pair_places[pair];
        cell = pair_cells[pair];
        is_tet = HAS_TETS && (!HAS_OTHERS || (floatBitsToUint(place.w) & IS_TET) != 0);
        slot = floatBitsToUint(place.w) & ~IS_TET;
        if (cell.x < found[slot]) {
            if (is_tet) {
                uvec4 vertices;
                vec3 corners[4];
                tet_corners(part, cell.x, vertices, corners);
                is_accepted = tet_accepts(place.xyz, corners, mesh.slack.w);
            } else if (HAS_OTHERS) {
                other = other_at(part, cell.x >> 1);
                is_accepted = other_accepts(part, other, place.xyz, weights);
            }
        }
    }
    if (is_accepted) atomicMin(found[slot], cell.x);
    together();
    if (is_accepted && found[slot] == cell.x) {
        uint bits = number;
        if (HAS_OTHERS && !is_tet) {
            float value = 0.0;
            bool is_valid = false;
            if (!CELL_DATA) is_valid = other_value(part, other, weights, value);
            found_value[slot] = value;
            bits |= IS_OTHER | (CELL_DATA ? 0 : HAS_VALUE) | (is_valid ? IS_VALID : 0);
        }
        found_part[slot] = bits;
        if (CELL_DATA) found_node[slot] = cell.y;
    }
    together();
}

// Searches one sub-mesh for the cells of samples that are still `open`.
void search_part(Mesh mesh, uint number, Segment segment, uint open) {
    Submesh part = mesh.submeshes.submesh[number];
    uint lane = gl_SubgroupInvocationID;
    uint octet = lane >> 3;
    uint child_number = lane & 7u;
    uint stack_base = gl_SubgroupID * STACK;
    uint queue_base = gl_SubgroupID * QUEUE;
    uint others_base = gl_SubgroupID * LANES * 4;
    uint pairs_base = gl_SubgroupID * LANES * 2;
    uint tets_base = gl_SubgroupID * LANES * TET_QUADS;
    vec3 start = segment.first - middle_of_beam();
    vec3 step = segment.steps > 0.0 ? (segment.last - segment.first) / segment.steps : vec3(0.0);
    vec3 least = 1e-12 * beams[gl_SubgroupID * BEAM_QUADS + 1].xyz + 1e-37;
    vec3 step_inverse = 1.0 / mix(step, least, lessThan(abs(step), least));
    // Of each sample: the tetrahedron with the lowest index that holds it for sure, and another cell
    // that may hold it, with their nodes.
    uint best[BLOCK];
    uint best_node[BLOCK];
    uint other[BLOCK];
    uint other_node[BLOCK];
    [[unroll]] for (uint i = 0; i < BLOCK; ++i) best[i] = NO_CELL;
    // Samples with such another cell, and those of them that have become pairs.
    uint have = 0;
    uint flushed = HAS_OTHERS ? 0 : BLOCK;
    // What waits: nodes, tetrahedra, other cells, pairs; and a batch of cells that are being tried.
    uint waiting = 1;
    uint queued = 0;
    uint num_others = 0;
    uint num_pairs = 0;
    uint batch = 0;
    uint tried = 0;
    bool is_of_tets = HAS_TETS;
    // Samples that are left of the cell that is being tried.
    uint left = 0;
    if (lane == 0) stack[stack_base] = 0;
    together();
    while (true) {
        bool is_done = waiting + queued + num_others == 0 && tried == batch;
        bool is_last = is_done && flushed == BLOCK;
        if (num_pairs >= LANES || (is_last && num_pairs > 0)) {
            uint count = min(num_pairs, LANES);
            num_pairs -= count;
            judge_pairs(mesh, part, number, num_pairs, count);
            continue;
        }
        if (is_last) break;
        if (tried < batch || is_done) {
            // What is to be judged becomes pairs: of the cell that is being tried, or at the end of
            // the other cells that lanes have kept.
            while ((is_done ? flushed < BLOCK : tried < batch) && num_pairs < LANES) {
                uint quad = tets_base + tried * TET_QUADS;
                bool is_pair = false;
                uint i = flushed;
                uvec2 cell = uvec2(0);
                if (HAS_OTHERS && is_done) {
                    is_pair = (have >> flushed & 1u) != 0;
                    [[unroll]] for (uint k = 0; k < BLOCK; ++k) {
                        if (k == flushed) cell = uvec2(other[k], CELL_DATA ? other_node[k] : 0);
                    }
                    ++flushed;
                } else {
                    if (!subgroupAny(left != 0)) {
                        if (HAS_TETS && (!HAS_OTHERS || is_of_tets)) {
                            uvec2 held = samples_of_tet(tried, segment, start, step, open);
                            left = held.x & ~held.y;
                            vec2 rest = tets[quad + 3].zw;
                            uint primitive = floatBitsToUint(rest.x);
                            [[unroll]] for (uint k = 0; k < BLOCK; ++k) {
                                bool is_held = (held.y >> k & 1u) != 0;
                                if (CELL_DATA && is_held && primitive < best[k]) {
                                    best_node[k] = floatBitsToUint(rest.y);
                                }
                                if (is_held) best[k] = min(best[k], primitive);
                            }
                        } else {
                            uint may = samples_of_box(tried, segment, start, step_inverse, open);
                            left = may & have;
                            uint fresh = may & ~have;
                            have |= fresh;
                            uint primitive = floatBitsToUint(tets[quad].w);
                            [[unroll]] for (uint k = 0; k < BLOCK; ++k) {
                                if ((fresh >> k & 1u) != 0) {
                                    other[k] = primitive;
                                    if (CELL_DATA) other_node[k] = floatBitsToUint(tets[quad + 1].w);
                                }
                            }
                        }
                        if (!subgroupAny(left != 0)) {
                            ++tried;
                            continue;
                        }
                    }
                    is_pair = left != 0;
                    i = is_pair ? uint(findLSB(left)) : 0;
                    left &= left - 1;
                    cell = is_of_tets
                        ? floatBitsToUint(tets[quad + 3].zw)
                        : uvec2(floatBitsToUint(tets[quad].w), floatBitsToUint(tets[quad + 1].w));
                    if (!subgroupAny(left != 0)) ++tried;
                }
                uvec4 pairs = subgroupBallot(is_pair);
                if (is_pair) {
                    uint pair = pairs_base + num_pairs + subgroupBallotExclusiveBitCount(pairs);
                    uint bits = found_slot(lane, i) | (!is_done && is_of_tets ? IS_TET : 0);
                    pair_places[pair] = vec4(place_of(i), uintBitsToFloat(bits));
                    pair_cells[pair] = cell;
                }
                num_pairs += subgroupBallotBitCount(pairs);
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
                is_met = set_up_tet(mesh, part, primitive, quads);
                if (CELL_DATA) quads[3].w = uintBitsToFloat(queue_node[queue_base + queued + lane]);
            }
            uvec4 met = subgroupBallot(is_met);
            if (is_met) {
                uint quad = tets_base + subgroupBallotExclusiveBitCount(met) * TET_QUADS;
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
                Beam beam = this_beam();
                cell = others[others_base + num_others + lane];
                Other other = other_at(part, cell.x >> 1);
                for (uint k = 0; k < 8; ++k) {
                    vec3 corner = vertex_at(part, other.vertices[k]);
                    lo = min(lo, corner);
                    hi = max(hi, corner);
                }
                is_met = meets(beam, lo, hi);
                lo = (lo - beam.middle) - 2.0 * mesh.slack.xyz;
                hi = (hi - beam.middle) + 2.0 * mesh.slack.xyz;
            }
            uvec4 met = subgroupBallot(is_met);
            if (is_met) {
                uint quad = tets_base + subgroupBallotExclusiveBitCount(met) * TET_QUADS;
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
            if (child.counts != 0 || child.is_inner) {
                // Powers of two but for the last sum.
                vec3 unit = 1.0 / part.sixteenths.xyz;
                vec3 lo = fma(child.lo, unit, part.base.xyz);
                vec3 hi = fma(child.hi, unit, part.base.xyz);
                is_hit = meets(this_beam(), lo, hi);
            }
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
        if (HAS_OTHERS && (part.kinds & HOLDS_OTHERS) != 0) {
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
    [[unroll]] for (uint i = 0; i < BLOCK; ++i) {
        uint slot = found_slot(lane, i);
        if (HAS_TETS && best[i] < found[slot]) {
            found[slot] = best[i];
            found_part[slot] = number;
            if (CELL_DATA) found_node[slot] = best_node[i];
        }
    }
}

// Searches those of some sub-meshes that the beam meets, in order: a cell of an earlier one comes
// first. Whether nothing is left to be found.
bool search_parts(Mesh mesh, uint first, uint end, Segment segment, inout uint open) {
    uint lane = gl_SubgroupInvocationID;
    for (; first < end; first += LANES) {
        uint number = first + lane;
        bool is_met = false;
        if (number < end) {
            vec3 lo = mesh.submeshes.submesh[number].lo.xyz;
            vec3 hi = mesh.submeshes.submesh[number].hi.xyz;
            is_met = meets(this_beam(), lo, hi);
        }
        while (true) {
            uint next = subgroupMin(is_met ? number : NO_CELL);
            if (next == NO_CELL) break;
            if (next == number) is_met = false;
            search_part(mesh, next, segment, open);
            [[unroll]] for (uint i = 0; i < BLOCK; ++i) {
                if (found[found_slot(lane, i)] != NO_CELL) open &= ~(1u << i);
            }
            if (!subgroupAny(open != 0)) return true;
        }
    }
    return false;
}

// Fills `found` in for the samples of all lanes' segments.
void search(Mesh mesh, Segment segment) {
    uint lane = gl_SubgroupInvocationID;
    [[unroll]] for (uint i = 0; i < BLOCK; ++i) found[found_slot(lane, i)] = NO_CELL;
    together();
    if (!subgroupAny(segment.mask != 0)) return;
    set_beam(segment, mesh.slack.xyz);
    uint open = segment.mask;
    uint num_groups = (mesh.num_submeshes + GROUP_PARTS - 1) / GROUP_PARTS;
    for (uint first = 0; first < num_groups; first += LANES) {
        uint group = first + lane;
        bool is_met = false;
        if (group < num_groups) {
            vec3 lo = mesh.groups.quad[2 * group].xyz;
            vec3 hi = mesh.groups.quad[2 * group + 1].xyz;
            is_met = meets(this_beam(), lo, hi);
        }
        while (true) {
            uint next = subgroupMin(is_met ? group : NO_CELL);
            if (next == NO_CELL) break;
            if (next == group) is_met = false;
            uint end = min((next + 1) * GROUP_PARTS, mesh.num_submeshes);
            if (search_parts(mesh, next * GROUP_PARTS, end, segment, open)) return;
        }
    }
}
