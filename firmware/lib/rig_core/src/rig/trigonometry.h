// Sine, cosine and arc tangent in single precision from sums and products alone: the ESP32's FPU has no double
// precision, which some C libraries use inside, and every machine gives the same bits.
#pragma once

namespace brov::rig {

// |x| <= 1 rad, which is more than any plate turns. Error below 1e-7.
float sine(float x);
float cosine(float x);
// -pi..pi. Error below 3e-7 rad. 0 for (0, 0).
float arc_tangent(float y, float x);

}  // namespace brov::rig
