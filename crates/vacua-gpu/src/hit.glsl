// What is met along a ray: shared by all shaders of a ray tracing pipeline.

struct Hit {
    // Number of the triangle or box; NO_HIT if there is none.
    uint primitive;
    float t;
};

const uint NO_HIT = 0xffffffffu;
