//! Empty-space skipping: macrocells, active mask, boundary mesh and ray intervals.
