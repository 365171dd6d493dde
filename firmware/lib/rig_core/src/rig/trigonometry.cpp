#include "rig/trigonometry.h"

namespace brov::rig {

namespace {

constexpr float kPi = 3.14159265f, kQuarterPi = 0.78539816f;
constexpr float kTanEighthPi = 0.41421356f;

// |x| <= tan(pi / 8): the series' terms as fitted by Chebyshev points in x^2, error 3e-10 before rounding.
float small_arc_tangent(float x) {
  const float z = x * x;
  const float series =
      z * (-0.33333307f + z * (0.19998211f + z * (-0.14239983f + z * (0.10572814f + z * -0.06033242f))));
  return x + x * series;
}

}  // namespace

float sine(float x) {
  const float z = x * x;
  // Taylor: the next term is 2.5e-8 at 1 rad.
  return x + x * z * (-1.0f / 6.0f + z * (1.0f / 120.0f + z * (-1.0f / 5040.0f + z * (1.0f / 362880.0f))));
}

float cosine(float x) {
  const float z = x * x;
  return 1.0f +
         z * (-0.5f + z * (1.0f / 24.0f + z * (-1.0f / 720.0f + z * (1.0f / 40320.0f + z * (-1.0f / 3628800.0f)))));
}

float arc_tangent(float y, float x) {
  const float across = x < 0.0f ? -x : x, up = y < 0.0f ? -y : y;
  const bool steep = up > across;
  const float longer = steep ? up : across, shorter = steep ? across : up;
  if (longer == 0.0f) return 0.0f;
  // atan(u) = pi/4 + atan((u - 1) / (u + 1)) where u is not small.
  float angle = shorter <= kTanEighthPi * longer ? small_arc_tangent(shorter / longer)
                                                 : kQuarterPi + small_arc_tangent((shorter - longer) / (shorter + longer));
  if (steep) angle = 0.5f * kPi - angle;
  if (x < 0.0f) angle = kPi - angle;
  return y < 0.0f ? -angle : angle;
}

}  // namespace brov::rig
