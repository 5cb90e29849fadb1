// Light from the camera, Blinn–Phong: what `vacua_render::contract::LIGHT` says comes with the
// parameters. Fused and `precise` throughout, so that all kinds of shaders make the same bits.

// Factor on the colour and white added to it, for a gradient and a unit direction in ray space.
vec2 shade(vec3 g, vec3 direction) {
    vec3 m = parameters.metric_squares.xyz;
    vec3 n = parameters.metric_products.xyz;
    precise float across_x = fma(g.x, m.x, fma(g.y, n.x, g.z * n.y));
    precise float across_y = fma(g.y, m.y, g.z * n.z);
    precise float length_sq = fma(g.x, across_x, fma(g.y, across_y, g.z * (g.z * m.z)));
    if (!(length_sq > 1.17549435e-38)) return vec2(1.0, 0.0);
    precise float along = fma(g.x, direction.x, fma(g.y, direction.y, g.z * direction.z));
    float cosine = min(abs(along) / sqrt(length_sq), 1.0);
    float shine = cosine;
    for (int i = 0; i < LIGHT_DOUBLINGS; ++i) shine *= shine;
    precise float factor = fma(parameters.light.y, cosine, parameters.light.x);
    return vec2(factor, parameters.light.z * shine);
}
