// Packets: the rays of a subgroup walk our own hierarchy over the faces of the boundary together. Of a node
// that their beam meets, each lane looks at a child; they go on to the one that begins nearest. Faces that
// the beam meets are tried by each ray.

// What a packet walks: the beam of all its rays, in numbers of samples that they have in common, and one
// over its steps.
struct Packet {
    Beam beam;
    vec3 inverse_lo;
    vec3 inverse_hi;
    // What is added to numbers of samples of this lane's ray for those in common.
    float behind;
};

// One over a number, or, of none, more than anything in a picture.
vec3 inverse_of(vec3 v) {
    return 1.0 / mix(v, vec3(1e-30), lessThan(abs(v), vec3(1e-30)));
}

Packet packet_of(Ray ray, bool is_seen) {
    uint window = subgroupMin(is_seen ? ray.window : 0xffffffffu);
    uint behind = is_seen ? (ray.window - window) * ALIGNMENT : 0;
    Beam beam = beam_of(ray, is_seen, behind);
    beam.lo -= parameters.flange;
    beam.hi += parameters.flange;
    return Packet(beam, inverse_of(beam.lo_step), inverse_of(beam.hi_step), float(behind));
}

// The samples between which a beam may meet bounds: from x to y, if x <= y.
vec2 span_of(Packet packet, Bounds bounds) {
    float enter = -LARGEST;
    float leave = LARGEST;
    for (int a = 0; a < 3; ++a) {
        float lo = macrocell_plane(a, bounds.lo[a]);
        float hi = macrocell_plane(a, bounds.hi[a]);
        // Where its lower side is below what is above, and its upper side above what is below.
        float below = (hi - packet.beam.lo[a]) * packet.inverse_lo[a];
        float above = (lo - packet.beam.hi[a]) * packet.inverse_hi[a];
        bool rises = packet.inverse_lo[a] > 0.0;
        leave = min(leave, rises ? below : LARGEST);
        enter = max(enter, rises ? -LARGEST : below);
        rises = packet.inverse_hi[a] > 0.0;
        enter = max(enter, rises ? above : -LARGEST);
        leave = min(leave, rises ? LARGEST : above);
    }
    return vec2(enter - 2e-6 * abs(enter), leave + 2e-6 * abs(leave));
}

// From (x, y, z) to (axis, next, next but one).
vec3 turned(vec3 v, int axis) {
    return axis == 0 ? v : axis == 1 ? v.yzx : v.zxy;
}

// Where a ray crosses a face that is sought, past `walk.at`; beyond everything if it does not.
float crossing_of(Ray ray, Walk walk, uint face) {
    int axis;
    bool looks_up;
    uvec3 place = place_of_face(face, axis, looks_up);
    vec3 step = turned(ray.step, axis);
    bool is_sought = walk.sought == FRONT == looks_up ? step.x < 0.0 : step.x > 0.0;
    vec3 start = turned(ray.start, axis);
    float inverse = turned(walk.inverse_step, axis).x;
    precise float crossing = (macrocell_plane(axis, place.x) - start.x) * inverse;
    int u = axis == 2 ? 0 : axis + 1;
    int v = axis == 0 ? 2 : axis - 1;
    vec2 lo = vec2(macrocell_plane(u, place.y), macrocell_plane(v, place.z));
    vec2 hi = vec2(macrocell_plane(u, place.y + 1), macrocell_plane(v, place.z + 1));
    vec2 at = fma(vec2(crossing), step.yz, start.yz);
    bool is_met = all(greaterThanEqual(at, lo - parameters.flange))
        && all(lessThanEqual(at, hi + parameters.flange));
    bool is_ahead = samples_around(ray, walk, crossing, inverse).y > walk.at;
    return is_sought && is_met && is_ahead ? crossing : LARGEST;
}

// The first face that is sought, of the rays that seek one.
uint first_face(Packet packet, Ray ray, Walk walk, bool seeks) {
    uint face = NO_FACE;
    float nearest = last_crossing(ray);
    float from = float(walk.at) - walk.reach - 1.0 + packet.behind;
    float first = subgroupMin(seeks ? from : LARGEST);
    float last = subgroupMax(seeks ? nearest + packet.behind : -LARGEST);
    uint lane = gl_SubgroupInvocationID;
    uint height = parameters.tree_height;
    uint node = 0;
    // Children that have not been visited: the lane of a height has those of its node.
    uint left = 0xffffffffu;
    while (height > 0) {
        uint children = subgroupShuffle(left, height);
        uint met = 0;
        float enter = LARGEST;
        uint next = 0;
        for (uint i = 0; i < WIDTH; i += LOOKERS) {
            uint child = i + lane;
            bool may_be = lane < LOOKERS && (children >> (child & 31u) & 1u) != 0
                && WIDTH * node + child < num_at(height - 1);
            if (may_be) {
                vec2 span = span_of(packet, bounds_at(height - 1, WIDTH * node + child));
                may_be = span.x <= span.y && span.x <= last && span.y >= first;
                if (may_be && span.x < enter) {
                    enter = span.x;
                    next = child;
                }
            }
            met |= subgroupBallot(may_be).x << i;
        }
        if (height == 1) {
            while (met != 0) {
                uint number = WIDTH * node + uint(findLSB(met));
                met &= met - 1;
                float crossing = seeks ? crossing_of(ray, walk, number) : LARGEST;
                if (crossing < nearest) {
                    nearest = crossing;
                    face = number;
                }
            }
            last = subgroupMax(seeks ? nearest + packet.behind : -LARGEST);
        }
        if (met == 0) {
            node /= WIDTH;
            ++height;
            if (height > parameters.tree_height) break;
            continue;
        }
        float least = subgroupMin(enter);
        next = subgroupShuffle(next, uint(findLSB(subgroupBallot(enter == least).x)));
        if (lane == height) left = met & ~(1u << next);
        if (lane == height - 1) left = 0xffffffffu;
        node = WIDTH * node + next;
        --height;
    }
    return face;
}
