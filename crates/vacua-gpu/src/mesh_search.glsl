// The cells of blocks of samples of all rays of a subgroup, found together.
//
// The rays are neighbours and the blocks lie side by side: a beam, in a box along its own axes. The
// subgroup goes through the tree once for all of them, a child a lane; then takes the cells of the
// leaves that the beam meets, sets up one a lane (planes of tetrahedra, planes around other cells),
// leaves out what the beam misses, and each ray tries those of them that it may meet: which of its samples
// a tetrahedron holds is the intersection of four half lines. Rounding is bounded, so that most samples
// are certain; pairs of cells and samples that are not wait until there is one for each lane, then all
// lanes judge them. Of other cells planes around them say which samples they may hold: of each sample the first
// two such cells wait until the batch has been tried, and the second is judged only if the first does not
// come before it.
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

// Nodes that wait, at most, and leaves: fewer than a batch, and those of nodes that are looked at together.
const uint STACK = 128;
const uint LEAVES = 2 * LANES;
// Where the number of tetrahedra of a leaf that have been taken begins among the bits of its counts.
const uint TAKEN_SHIFT = 8;
// Quads of words that a beam takes.
const uint BEAM_QUADS = 6;
// Bound on the rounding of volumes along rays. A normal's component is a difference of products of the
// cell's other two sides; with the way along its axis from the beam's middle and summed over the axes,
// these products are rounded some seventy times a volume, and the last volume is what is left by three.
const float BEAM_ROUNDING = 256.0 / 16777216.0;
// Slopes of volumes along rays, smaller than which none is told from; and what that takes at most.
const float LEAST_SLOPE = 1e-30;
const float SLOPE_ROUNDING = 1e-28;
// Where among a pair's bits the lane begins whose sample it is, and the one whose cell; the sample's number
// comes before them.
const uint LANE_SHIFT = 3;
const uint CELL_SHIFT = 16;
// Set with a sub-mesh's number where the cell is no tetrahedron and `found_value` holds its value; which is
// this where it has none.
const uint IS_OTHER = 0x80000000u;
const uint NO_NUMBER = 0x7fc00000u;

shared uint stack[SUBGROUPS * STACK];
// Leaves with tetrahedra that wait: where their indices begin, and their counts.
shared uint leaf_first[HAS_TETS ? SUBGROUPS * LEAVES : 1];
shared uint leaf_counts[HAS_TETS ? SUBGROUPS * LEAVES : 1];
shared uint leaf_node[CELL_DATA && HAS_TETS ? SUBGROUPS * LEAVES : 1];
shared uint others[HAS_OTHERS ? SUBGROUPS * LANES * 4 : 1];
shared uint others_node[CELL_DATA && HAS_OTHERS ? SUBGROUPS * LANES * 4 : 1];
shared vec4 beams[SUBGROUPS * BEAM_QUADS];
shared uint pair_bits[SUBGROUPS * LANES * 2];
shared uint pair_cell[HAS_TETS ? SUBGROUPS * LANES * 2 : 1];
shared uint pair_node[CELL_DATA && HAS_TETS ? SUBGROUPS * LANES * 2 : 1];
// For each sample of each lane: primitive, sub-mesh with the bits above, node, value.
shared uint found[SUBGROUPS * LANES * BLOCK];
shared uint found_part[NEEDS_PARTS ? SUBGROUPS * LANES * BLOCK : 1];
shared uint found_node[CELL_DATA && HAS_TETS ? SUBGROUPS * LANES * BLOCK : 1];
shared float found_value[HAS_OTHERS ? SUBGROUPS * LANES * BLOCK : 1];

// Where the rays of the lane's column and row of the subgroup's tile are along the beam's first two axes.
vec2 ray_column;
vec2 ray_row;

// Where sample `i` of the lane's block is, in the mesh's own space.
vec3 place_of(uint i);
// Where a sample of another lane's is; all lanes ask together.
vec3 place_of_lane(uint lane, uint i);
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
#include "mesh_batch.glsl"

// Puts pairs of samples and cells at the end of those that wait, of the lanes that have one; how many there
// are now.
uint wait_in_pairs(bool is_pair, uint i, uint bits, uvec2 cell, uint num_pairs) {
    uvec4 pairs = subgroupBallot(is_pair);
    if (is_pair) {
        uint pair = gl_SubgroupID * LANES * 2 + num_pairs + subgroupBallotExclusiveBitCount(pairs);
        pair_bits[pair] = bits | gl_SubgroupInvocationID << LANE_SHIFT | i;
        if (HAS_TETS) pair_cell[pair] = cell.x;
        if (HAS_TETS && CELL_DATA) pair_node[pair] = cell.y;
    }
    return num_pairs + subgroupBallotBitCount(pairs);
}

// A pair that a lane judges: number of the sample, lane whose it is, lane whose cell it is.
uvec3 pair_at(uint pair) {
    uint bits = pair_bits[pair];
    return uvec3(
        bits & (BLOCK - 1), bits >> LANE_SHIFT & (LANES - 1), bits >> CELL_SHIFT
    );
}

// Settles the last `count` pairs of tetrahedra that wait, one a lane.
void judge_tets(Mesh mesh, Submesh part, uint number, uint first, uint count) {
    uint lane = gl_SubgroupInvocationID;
    uint pair = gl_SubgroupID * LANES * 2 + first + min(lane, count - 1);
    uvec3 of = pair_at(pair);
    vec3 place = place_of_lane(of.y, of.x);
    uint slot = found_slot(of.y, of.x);
    uint primitive = pair_cell[pair];
    bool is_accepted = false;
    if (lane < count && primitive < found[slot]) {
        uvec4 vertices;
        vec3 corners[4];
        tet_corners(part, primitive, vertices, corners);
        is_accepted = tet_accepts(place, corners, mesh.slack.w);
    }
    if (is_accepted) atomicMin(found[slot], primitive);
    together();
    if (is_accepted && found[slot] == primitive) {
        found_part[slot] = number;
        if (CELL_DATA) found_node[slot] = pair_node[pair];
    }
    together();
}

// The same of other cells, of which each lane has one, with its node.
void judge_others(Submesh part, uint number, uvec2 own, uint first, uint count) {
    uint lane = gl_SubgroupInvocationID;
    uvec3 of = pair_at(gl_SubgroupID * LANES * 2 + first + min(lane, count - 1));
    vec3 place = place_of_lane(of.y, of.x);
    uint slot = found_slot(of.y, of.x);
    uint primitive = subgroupShuffle(own.x, of.z);
    uint node = CELL_DATA ? subgroupShuffle(own.y, of.z) : 0;
    Other other;
    Weights weights;
    bool is_accepted = false;
    if (lane < count && primitive < found[slot]) {
        other = other_at(part, primitive >> 1);
        is_accepted = other_accepts(part, other, place, weights);
    }
    if (is_accepted) atomicMin(found[slot], primitive);
    together();
    if (is_accepted && found[slot] == primitive) {
        float value;
        bool is_valid;
        if (CELL_DATA) {
            value = cell_value(part, node, primitive);
            is_valid = is_number(value);
        } else {
            float values[8];
            other_values(part, other, values);
            is_valid = other_value(values, weights, value);
        }
        found_value[slot] = is_valid ? value : uintBitsToFloat(NO_NUMBER);
        if (NEEDS_PARTS) found_part[slot] = number | IS_OTHER;
    }
    together();
}

// Keeps a tetrahedron for some of the lane's samples that it holds for sure.
void keep(uint number, uvec2 cell, uint sure) {
    while (sure != 0) {
        uint slot = found_slot(gl_SubgroupInvocationID, uint(findLSB(sure)));
        sure &= sure - 1;
        if (cell.x >= found[slot]) continue;
        found[slot] = cell.x;
        found_part[slot] = number;
        if (CELL_DATA) found_node[slot] = cell.y;
    }
}

// Takes a tetrahedron a lane from the leaves that wait: the primitive, if there is one, and its node.
uvec2 next_tet(inout uint num_leaves, inout uint queued) {
    uint lane = gl_SubgroupInvocationID;
    bool is_leaf = lane < min(num_leaves, BATCH);
    uint place = gl_SubgroupID * LEAVES + num_leaves - 1 - lane;
    uint counts = is_leaf ? leaf_counts[place] : 0;
    uint first = is_leaf ? leaf_first[place] : 0;
    uint node = CELL_DATA && is_leaf ? leaf_node[place] : 0;
    uint taken = counts >> TAKEN_SHIFT;
    uint num_tets = leaf_tets(counts) - taken;
    uint before = subgroupExclusiveAdd(num_tets);
    // Each leaf sets the bit of its first lane.
    uint starts = subgroupOr(is_leaf && before < BATCH ? 1u << before : 0);
    uint count = min(queued, BATCH);
    bool is_there = lane < count;
    uint leaf = is_there ? bitCount(starts & ((2u << lane) - 1)) - 1 : 0;
    uint own_counts = subgroupShuffle(counts, leaf);
    uint own_first = subgroupShuffle(first, leaf);
    uint own_node = CELL_DATA ? subgroupShuffle(node, leaf) : 0;
    uint number = lane - subgroupShuffle(before, leaf) + (own_counts >> TAKEN_SHIFT);
    bool is_used_up = is_leaf && before + num_tets <= count;
    if (is_leaf && before < count && !is_used_up) {
        leaf_counts[place] = (counts & 63u) | (taken + count - before) << TAKEN_SHIFT;
    }
    num_leaves -= subgroupBallotBitCount(subgroupBallot(is_used_up));
    queued -= count;
    together();
    uint singles = own_counts & 3u;
    uint pair = number - singles;
    uint primitive = number < singles
        ? 2 * (own_first + 4 * number)
        : 2 * (own_first + 4 * singles + 5 * (pair >> 1)) + (pair & 1u);
    return uvec2(is_there ? primitive : NO_CELL, own_node);
}

// Bits of samples as bytes.
uvec2 bytes_of(uint bits) {
    return (uvec2(bits, bits >> 4) & 15u) * 0x00204081u & 0x01010101u;
}

// Tries the other cells of the batch, of which `mine` are those that the lane's ray may meet.
void try_others(
    Submesh part,
    uint number,
    uvec2 own,
    Planes planes,
    Segment segment,
    vec3 start,
    vec3 step,
    uint open,
    uint mine
) {
    // Lanes whose cells are the first and the second cell that may hold a sample, a byte each.
    uvec2 first = uvec2(0);
    uvec2 second = uvec2(0);
    uint have_first = 0;
    uint have_second = 0;
    // Samples that are to become pairs with some cell.
    uint left = 0;
    uvec2 cells = uvec2(0);
    uint num_pairs = 0;
    // Cells are being tried; then what waits becomes pairs, first cells, then second ones.
    uint stage = 0;
    while (true) {
        while (num_pairs < LANES) {
            if (!subgroupAny(left != 0)) {
                if (subgroupAny(mine != 0)) {
                    uint slot = mine != 0 ? uint(findLSB(mine)) : 0;
                    Planes around = planes_of(planes, slot);
                    uint may = samples_of_other(around, segment, start, step, open);
                    if (mine == 0) may = 0;
                    mine &= mine - 1;
                    uint fresh = may & ~have_first;
                    first |= bytes_of(fresh) * slot;
                    have_first |= fresh;
                    may &= ~fresh;
                    fresh = may & ~have_second;
                    second |= bytes_of(fresh) * slot;
                    have_second |= fresh;
                    left = may & ~fresh;
                    cells = uvec2(0x01010101u * slot);
                    continue;
                }
                if (stage == 2 || (stage == 1 && num_pairs > 0)) break;
                ++stage;
                left = have_first;
                cells = first;
                if (stage == 2) {
                    left = have_second;
                    cells = second;
                    [[unroll]] for (uint i = 0; i < BLOCK; ++i) {
                        uint slot = cells[i >> 2] >> (8 * (i & 3u)) & 255u;
                        uint primitive = subgroupShuffle(own.x, slot);
                        if (found[found_slot(gl_SubgroupInvocationID, i)] < primitive) {
                            left &= ~(1u << i);
                        }
                    }
                }
                continue;
            }
            bool is_pair = left != 0;
            uint i = is_pair ? uint(findLSB(left)) : 0;
            left &= left - 1;
            uint slot = (i < 4 ? cells.x : cells.y) >> (8 * (i & 3u)) & 255u;
            num_pairs = wait_in_pairs(is_pair, i, slot << CELL_SHIFT, uvec2(0), num_pairs);
        }
        if (num_pairs == 0) break;
        together();
        uint count = min(num_pairs, LANES);
        num_pairs -= count;
        judge_others(part, number, own, num_pairs, count);
    }
}

// Searches one sub-mesh for the cells of samples that are still `open`.
void search_part(Mesh mesh, uint number, Segment segment, uint open) {
    Submesh part = mesh.submeshes.submesh[number];
    uint lane = gl_SubgroupInvocationID;
    uint octet = lane >> 3;
    uint child_number = lane & 7u;
    uint stack_base = gl_SubgroupID * STACK;
    uint leaves_base = gl_SubgroupID * LEAVES;
    uint others_base = gl_SubgroupID * LANES * 4;
    vec3 start = segment.first - middle_of_beam();
    vec3 step = segment.steps > 0.0 ? (segment.last - segment.first) / segment.steps : vec3(0.0);
    // What waits: nodes, leaves and their tetrahedra, other cells, pairs.
    uint waiting = 1;
    uint num_leaves = 0;
    uint queued = 0;
    uint num_others = 0;
    uint num_pairs = 0;
    // Tetrahedra of the batch that the lane's ray is to try; samples that are left of the one that it tries.
    uint mine = 0;
    uint left = 0;
    uvec2 cell = uvec2(0);
    Tet tet;
    if (lane == 0) stack[stack_base] = 0;
    together();
    while (true) {
        bool is_trying = HAS_TETS && subgroupAny((mine | left) != 0);
        bool is_drained = waiting + queued == 0 && !is_trying;
        bool is_others_turn = HAS_OTHERS && !is_trying
            && (num_others >= BATCH || (is_drained && num_others > 0));
        if (HAS_TETS && num_pairs > 0 && (num_pairs >= LANES || is_drained || is_others_turn)) {
            uint count = min(num_pairs, LANES);
            num_pairs -= count;
            judge_tets(mesh, part, number, num_pairs, count);
            continue;
        }
        if (is_trying) {
            while (num_pairs < LANES) {
                if (!subgroupAny(left != 0)) {
                    if (!subgroupAny(mine != 0)) break;
                    Tet tried = tet_of(tet, mine != 0 ? uint(findLSB(mine)) : 0);
                    if (mine != 0) {
                        uvec2 held = samples_of_tet(tried, segment, start, step, open);
                        left = held.x & ~held.y;
                        cell = uvec2(tried.primitive, tried.node);
                        keep(number, cell, held.y);
                    }
                    mine &= mine - 1;
                    continue;
                }
                bool is_pair = left != 0;
                uint i = is_pair ? uint(findLSB(left)) : 0;
                left &= left - 1;
                num_pairs = wait_in_pairs(is_pair, i, 0, cell, num_pairs);
            }
            together();
            continue;
        }
        if (HAS_TETS && (queued >= BATCH || (waiting == 0 && queued > 0))) {
            uvec2 waited = next_tet(num_leaves, queued);
            vec4 range = vec4(0.0);
            bool is_met = false;
            if (waited.x != NO_CELL) is_met = set_up_tet(mesh, part, waited.x, tet, range);
            tet.node = waited.y;
            mine = cells_of_ray(is_met, range);
            if (open == 0) mine = 0;
            continue;
        }
        if (is_others_turn) {
            uint count = min(num_others, BATCH);
            num_others -= count;
            vec4 range = vec4(0.0);
            bool is_met = false;
            uvec2 own = uvec2(0);
            Planes planes;
            if (lane < count) {
                uint place = others_base + num_others + lane;
                own = uvec2(others[place], CELL_DATA ? others_node[place] : 0);
                is_met = set_up_other(mesh, part, own.x, planes, range);
            }
            uint met = cells_of_ray(is_met, range);
            if (open == 0) met = 0;
            try_others(part, number, own, planes, segment, start, step, open, met);
            continue;
        }
        if (waiting == 0) break;
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
        bool is_pushed = is_hit && child.is_inner;
        uvec4 pushed = subgroupBallot(is_pushed);
        if (is_pushed) {
            uint place = waiting + subgroupBallotExclusiveBitCount(pushed);
            if (place < STACK) stack[stack_base + place] = below;
            else mesh.overflow = 1;
        }
        waiting = min(waiting + subgroupBallotBitCount(pushed), STACK);
        uint singles = child.counts & 3u;
        if (HAS_TETS) {
            uint num_tets = is_leaf ? leaf_tets(child.counts) : 0;
            uvec4 kept = subgroupBallot(num_tets > 0);
            if (num_tets > 0) {
                uint place = leaves_base + num_leaves + subgroupBallotExclusiveBitCount(kept);
                leaf_first[place] = first_index;
                leaf_counts[place] = child.counts & 63u;
                if (CELL_DATA) leaf_node[place] = node;
            }
            num_leaves += subgroupBallotBitCount(kept);
            queued += subgroupAdd(num_tets);
        }
        if (HAS_OTHERS && (part.kinds & HOLDS_OTHERS) != 0) {
            uint count = is_leaf ? child.counts >> 6 : 0;
            uint place = num_others + subgroupExclusiveAdd(count);
            first_index += 4 * singles + 5 * (child.counts >> 2 & 15u);
            for (uint i = 0; i < count; ++i) {
                others[others_base + place + i] = 2 * (first_index + 8 * i);
                if (CELL_DATA) others_node[others_base + place + i] = node;
            }
            num_others += subgroupAdd(count);
        }
        together();
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
