// `mesh`: rays find where they enter and leave the active region by its triangulated boundary (paper A
// §4.3).
//
// From a sample in an active macrocell the next back face is sought, else the next front face. A face only
// says which plane the ray crosses there; the samples around it follow from the plane itself, as they do
// for every method. Deviation: the paper reads the state after a hit from its kind; here it is read from
// the mask at the first sample that is certainly past the hit, so that a hit too many along an edge does no
// harm, and faces are a little wider than they are, so that none is missed there. And where the active
// region ends is sought by the mask at first, as it mostly ends within some macrocells, and so is where the
// next one begins: most faces need no ray to be traced. Rays that graze planes are led by the mask alone.
//
// The including stage finds the first face beyond `walk.at` that is sought, and gives it to `take`, as long
// as one is sought.

// Macrocells that a ray follows the active region by the mask, and a gap behind it.
const int FOLLOWED = 32;
const int CROSSED = 8;

// A ray whose computed coordinates may reach a plane this many samples before or after the line does is not
// traced: where it meets a face would not tell which samples are past it.
const float MOST_REACH = 0.25;

const uint NO_FACE = 0xffffffffu;

// What is sought: nothing any more, where the ray enters what is active, where it leaves it.
const uint NOTHING = 0;
const uint FRONT = 1;
const uint BACK = 2;

struct Walk {
    vec3 inverse_step;
    // Samples between two crossings of planes, computed and true, at most.
    float reach;
    uint sought;
    // The first sample that may be active and is in no run.
    uint k;
    // The face that is sought lies at or beyond this sample; all between is like it.
    uint at;
};

// Samples between two crossings of planes, computed and true, at most. Axes along which no sample's
// computed coordinate differs from the first have none.
float reach_of(Ray ray, vec3 inverse_step) {
    float reach = 0.0;
    for (int a = 0; a < 3; ++a) {
        bool stands = abs(ray.step[a]) * float(ray.end) < 0.25 * half_gap(ray.start[a]);
        if (!stands) reach = max(reach, parameters.length_sq.w * abs(inverse_step[a]));
    }
    return reach;
}

bool is_active(Ray ray, uint k) {
    return is_active(uvec3(macrocell_of(position(ray, float(k)))));
}

// Moves `walk.at`, in an active macrocell, to the first sample in another that is not, if it is near, else to
// one before it; whether it is, or the ray ends before.
bool follow(Ray ray, inout Walk walk) {
    bool is_traced = walk.reach <= MOST_REACH;
    for (int i = 0; walk.at < ray.end; ++i) {
        uint next;
        if (look_ahead(ray, walk.inverse_step, walk.at, next) > 0) break;
        if (is_traced && i == FOLLOWED) return false;
        walk.at = next;
    }
    return true;
}

// Moves `walk.k` to the first sample that is in an active macrocell, if it is near; whether it is. A ray begins
// far from what is active.
bool cross(Ray ray, inout Walk walk) {
    bool is_traced = walk.reach <= MOST_REACH;
    int most = walk.k == ray.begin ? 0 : CROSSED;
    for (int i = 0; walk.k < ray.end; ++i) {
        uint next;
        if (look_ahead(ray, walk.inverse_step, walk.k, next) == 0) return true;
        if (is_traced && i == most) break;
        walk.k = next;
    }
    return false;
}

// Goes on from `walk.k` until a face must be sought.
void go_on(Ray ray, inout Walk walk, inout Runs runs) {
    walk.sought = NOTHING;
    while (walk.k < ray.end) {
        bool is_inside = cross(ray, walk);
        walk.at = walk.k;
        if (!is_inside) {
            if (walk.k < ray.end) walk.sought = FRONT;
            return;
        }
        if (!follow(ray, walk)) {
            walk.sought = BACK;
            return;
        }
        walk.k = add_run(runs, ray, walk.k, walk.at);
    }
}

Walk walk_of(Ray ray, inout Runs runs) {
    vec3 inverse_step = 1.0 / ray.step;
    float reach = reach_of(ray, inverse_step);
    Walk walk = Walk(inverse_step, reach, NOTHING, ray.begin, ray.begin);
    go_on(ray, walk, runs);
    return walk;
}

// Samples between which a ray crosses a plane: the first that may be past it, or past another plane that the
// line reaches later, and the first that certainly is past it.
uvec2 samples_around(Ray ray, Walk walk, float crossing, float inverse_step) {
    float rounding = 2e-6 * abs(crossing);
    float slack = rounding + parameters.length_sq.w * abs(inverse_step);
    float before = crossing - max(slack, rounding + walk.reach);
    float limit = float(ray.end);
    return uvec2(
        clamp(ceil(before), 0.0, limit), clamp(floor(crossing + slack) + 1.0, 0.0, limit)
    );
}

// The last place of a ray at which a face is sought.
float last_crossing(Ray ray) {
    return fma(4e-6, float(ray.end), float(ray.end) + 1.0);
}

// The samples around a ray's crossing of the plane that a face lies in; none if it runs along it.
uvec2 samples_around(Ray ray, Walk walk, uint face) {
    uint word = parameters.faces.word[3 * face];
    int axis = int(word & 3u);
    if (ray.step[axis] == 0.0) return uvec2(0);
    float inverse = walk.inverse_step[axis];
    precise float crossing = (macrocell_plane(axis, word >> 3) - ray.start[axis]) * inverse;
    return samples_around(ray, walk, crossing, inverse);
}

// Goes on from the face that was sought, or to the end of the ray if there is none.
void take(Ray ray, inout Walk walk, inout Runs runs, uint face) {
    if (face == NO_FACE) {
        if (walk.sought == BACK) add_run(runs, ray, walk.k, ray.end);
        walk.sought = NOTHING;
        return;
    }
    uvec2 around = samples_around(ray, walk, face);
    walk.at = around.y;
    if (walk.sought == FRONT) {
        walk.k = max(walk.k, around.x);
        bool is_inside = walk.at < ray.end && is_active(ray, walk.at);
        if (is_inside && !follow(ray, walk)) {
            walk.sought = BACK;
            return;
        }
    }
    walk.k = add_run(runs, ray, walk.k, walk.at);
    go_on(ray, walk, runs);
}
