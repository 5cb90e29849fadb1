// What is ahead of a subgroup's rays, by the map of macrocells: each lane looks at a piece of their beam.

// What a subgroup looks at, besides the beam that it keeps.
struct Ahead {
    // Samples that any of its rays sees.
    uint begin;
    uint end;
};

// In shared memory, from where lanes read it when they look ahead, not to have it in registers while
// they sample.
shared vec4 beams[3 * SUBGROUPS];

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

Ahead ahead_of(Ray ray, bool is_seen, uint behind, uint begin, uint end, uvec2 own) {
    keep(beam_of(ray, is_seen, behind));
    return Ahead(begin, end);
}

uint rounds_from(inout Ahead ahead, uint first, bool has_ended) {
    uint round = first + ROUND * gl_SubgroupInvocationID;
    bool is_due = gl_SubgroupInvocationID < LOOKERS && round < ahead.end && round + ROUND > ahead.begin;
    return subgroupBallot(is_due && may_be_active(kept(), round, round + ROUND - 1)).x;
}

uint stretches_from(inout Ahead ahead, uint first, bool has_ended) {
    uint stretch = first + STRETCH * gl_SubgroupInvocationID;
    bool is_wanted = gl_SubgroupInvocationID < LOOKERS
        && may_be_active(kept(), stretch, stretch + STRETCH - 1);
    return subgroupBallot(is_wanted).x;
}
