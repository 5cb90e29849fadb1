// The subgroups of workgroups that are as large as the device has them.

layout(local_size_x_id = 11) in;

// Lanes of a subgroup, and subgroups of a workgroup.
layout(constant_id = 9) const uint LANES = 32;
layout(constant_id = 10) const uint SUBGROUPS = 16;
// Lanes that look at something for all; one's answer is a bit.
const uint LOOKERS = LANES < 32 ? LANES : 32;
