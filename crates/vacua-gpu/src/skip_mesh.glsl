// `mesh`: rays find where they enter and leave the active region by tracing its triangulated boundary
// (paper A §4.3).
//
// From a sample in an active macrocell the next back face is sought, else the next front face. A hit
// only says which plane the ray crosses there; the samples around it follow from the plane itself, as
// they do for every method. Deviation: the paper reads the state after a hit from its kind; here it is
// read from the mask at the first sample that is certainly past the hit, so that a hit too many along
// an edge does no harm, and faces are a little wider than they are, so that none is missed there. And
// where the active region ends is sought by the mask at first, as it mostly ends within some macrocells:
// that saves every other ray.
//
// The including stage has `first_hit`.

// Macrocells that a ray follows the active region by the mask.
const int FOLLOWED = 8;

// The first face that a half-line meets beyond `t_min` and before `t_max`: of those that it sees from
// behind where `from_inside`, else of those that it sees from the front.
Hit first_hit(vec3 origin, float t_min, vec3 direction, float t_max, bool from_inside);

struct Walk {
    vec3 inverse_step;
    // Samples between two crossings of planes, computed and true, at most.
    float reach;
    // Rays are traced from this sample on, before the first that is seen.
    float base;
    vec3 origin;
    float t_max;
};

Walk walk_of(Ray ray) {
    Walk walk;
    walk.inverse_step = 1.0 / ray.step;
    // Axes along which no sample's computed coordinate differs from the first need no reach.
    float slack = parameters.length_sq.w;
    walk.reach = 0.0;
    float samples = float(ray.end);
    for (int a = 0; a < 3; ++a) {
        bool stands = abs(ray.step[a]) * samples < 0.25 * half_gap(ray.start[a]);
        if (!stands) walk.reach = max(walk.reach, slack * abs(walk.inverse_step[a]));
    }
    walk.base = float(ray.begin) - 2.0;
    walk.origin = position(ray, walk.base);
    walk.t_max = samples - walk.base + 1.0;
    return walk;
}

bool is_active(Ray ray, uint k) {
    return is_active(uvec3(macrocell_of(position(ray, float(k)))));
}

// Moves a sample in an active macrocell to the first in another that is not, if it is near; whether it
// is, or the ray ends before.
bool follow(Ray ray, vec3 inverse_step, inout uint k) {
    for (int i = 0; i <= FOLLOWED; ++i) {
        uint next;
        if (k >= ray.end || look_ahead(ray, inverse_step, k, next) > 0) return true;
        k = next;
    }
    return false;
}

void seek(Ray ray, inout Walk walk, inout uint k, inout uint stop) {
    while (k >= stop && k < ray.end) {
        // All before k is done; what is active from k on ends at a back face, or begins at a front
        // face.
        uint at = k;
        bool inside = is_active(ray, at);
        if (inside && follow(ray, walk.inverse_step, at)) {
            stop = at;
            break;
        }
        float t_min = max(float(at) - 0.5 - walk.reach - walk.base, 0.0);
        while (true) {
            Hit hit = first_hit(walk.origin, t_min, ray.step, walk.t_max, inside);
            if (hit.primitive == NO_HIT) {
                stop = ray.end;
                if (!inside) k = ray.end;
                break;
            }
            uint face = parameters.faces.word[3 * (hit.primitive / 2)];
            int axis = int(face & 3u);
            uint cell = min((face >> 3) * parameters.macrocells.w, parameters.cells[axis]);
            float inverse = walk.inverse_step[axis];
            precise float crossing = (plane_at(axis, cell) - ray.start[axis]) * inverse;
            float slack = fma(2e-6, abs(crossing), parameters.length_sq.w * abs(inverse));
            // The first sample that may be past the plane, and the first that certainly is.
            float limit = float(ray.end);
            uint may = uint(clamp(ceil(crossing - slack), 0.0, limit));
            uint past = uint(clamp(floor(crossing + slack) + 1.0, 0.0, limit));
            if (past <= at || ray.step[axis] == 0.0) {
                // This one has been passed, or the ray runs along it.
                t_min = uintBitsToFloat(floatBitsToUint(max(hit.t, t_min)) + 1u);
                continue;
            }
            if (inside) {
                stop = past;
                break;
            }
            k = max(k, may);
            at = past;
            stop = past;
            if (at >= ray.end || !is_active(ray, at)) break;
            inside = true;
            if (follow(ray, walk.inverse_step, at)) {
                stop = at;
                break;
            }
            t_min = max(float(at) - 0.5 - walk.reach - walk.base, 0.0);
        }
    }
}
