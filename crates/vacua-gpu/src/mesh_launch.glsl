// What a ray tracing pipeline over a mesh is launched for: one ray a pixel, or the cells at a list of
// places, each on its own.

// Whether it is places; as many as the picture is wide.
layout(constant_id = 43) const bool PLACES = false;

void launch(Mesh mesh) {
    uvec2 own = gl_LaunchIDEXT.xy;
    if (!PLACES) {
        make_pixel(mesh, own);
        return;
    }
    uint index = own.x + own.y * gl_LaunchSizeEXT.x;
    if (index >= parameters.picture.x) return;
    vec3 place = push.clips.quad[index].xyz;
    Found at;
    bool is_found = find_on_its_own(mesh, place, at);
    store_sample(mesh, index, place, is_found, at.cell);
}
