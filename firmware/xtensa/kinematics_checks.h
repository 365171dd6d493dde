#pragma once

// The rig's inverse kinematics over many set points: prints a checksum of all angles' bits and, as measures, the
// instructions of six legs and of one step of the whole stack.
void check_kinematics();
