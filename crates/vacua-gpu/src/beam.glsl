// Beams: what all rays of a subgroup pass through. In numbers of samples that a subgroup's rays have in
// common, the coordinates of all of them lie in a box that moves and grows linearly.

// Lanes of a subgroup, and subgroups of a workgroup.
layout(constant_id = 9) const uint LANES = 32;
layout(constant_id = 10) const uint SUBGROUPS = 16;
// Samples that a lane looks ahead for all: a part of a block, so that what follows an active macrocell is
// not sampled far beyond it.
const uint STRETCH = 4;
// Lanes that look ahead; one's answer is a bit. Together they look over a round.
const uint LOOKERS = LANES < 32 ? LANES : 32;
const uint ROUND = STRETCH * LOOKERS;

struct Beam {
    vec3 lo;
    vec3 lo_step;
    vec3 hi;
    vec3 hi_step;
};

// In shared memory, from where lanes read it when they look ahead, not to have it in registers while
// they sample.
shared vec4 beams[3 * SUBGROUPS];

// The beam of this subgroup; a ray is `behind` with its numbers.
Beam beam_of(Ray ray, bool is_seen, uint behind) {
    // What rounding moves coordinates by, and those of a start that is moved.
    float slack = 2.0 * parameters.length_sq.w;
    const float FAR = 1e30;
    vec3 start = fma(vec3(-float(behind)), ray.step, ray.start);
    Beam beam;
    beam.lo = subgroupMin(is_seen ? start : vec3(FAR)) - slack;
    beam.hi = subgroupMax(is_seen ? start : vec3(-FAR)) + slack;
    beam.lo_step = subgroupMin(is_seen ? ray.step : vec3(FAR));
    beam.hi_step = subgroupMax(is_seen ? ray.step : vec3(-FAR));
    return beam;
}

void keep(Beam beam) {
    if (subgroupElect()) {
        uint place = 3 * gl_SubgroupID;
        beams[place] = vec4(beam.lo, beam.lo_step.x);
        beams[place + 1] = vec4(beam.lo_step.yz, beam.hi.xy);
        beams[place + 2] = vec4(beam.hi.z, beam.hi_step);
    }
    subgroupMemoryBarrierShared();
    subgroupBarrier();
}

Beam kept() {
    uint place = 3 * gl_SubgroupID;
    vec4 p = beams[place];
    vec4 q = beams[place + 1];
    vec4 r = beams[place + 2];
    return Beam(p.xyz, vec3(p.w, q.xy), vec3(q.zw, r.x), r.yzw);
}

// Whether any sample of a beam from `first` to `last`, both included, may be in an active macrocell: one
// look at the map.
bool may_be_active(Beam beam, uint first, uint last) {
    float p = float(first);
    float q = float(last);
    vec3 lo = min(fma(vec3(p), beam.lo_step, beam.lo), fma(vec3(q), beam.lo_step, beam.lo));
    vec3 hi = max(fma(vec3(p), beam.hi_step, beam.hi), fma(vec3(q), beam.hi_step, beam.hi));
    vec3 most = vec3(parameters.macrocells.xyz - 1);
    float scale = parameters.last_cell.w;
    uvec3 from = uvec3(clamp(lo * scale, vec3(0.0), most));
    uvec3 to = uvec3(clamp(hi * scale, vec3(0.0), most));
    uvec3 span = to - from;
    uint widest = max(span.x, max(span.y, span.z));
    if (widest <= 1) {
        uint box = span.x | span.y << 1 | span.z << 2;
        uint byte = map_at(from);
        return ((byte >> box | byte >> 7) & 1u) == 0;
    }
    return distance_of(map_at((from + to + 1) / 2)) <= (widest + 1) / 2;
}
