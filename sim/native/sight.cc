// Finds what a viewer sees in its cone; see `visibility.py`.

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "batch.h"
#include "map.h"
#include "nearest.h"

namespace drivetrain {
namespace {

constexpr float kPi = 3.14159265358979323846f;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

struct Cone {
  float x, y, yaw, angle, distance;
  float cos, sin, cos_half, sin_half;

  explicit Cone(const float* operand)
      : x(operand[0]), y(operand[1]), yaw(operand[2]), angle(operand[3]),
        distance(operand[4]), cos(std::cos(yaw)), sin(std::sin(yaw)),
        cos_half(std::cos(angle / 2)), sin_half(std::sin(angle / 2)) {}

  // Of an offset from the viewer, and its length; the slack is `visibility.py`'s.
  bool is_between_sides(float dx, float dy, float length) const {
    return dx * cos + dy * sin >= (cos_half - 1e-6f) * length;
  }

  // Whether a disc about an offset can reach between the sides.
  bool can_touch(float dx, float dy, float radius) const {
    const float ahead = dx * cos + dy * sin, aside = std::abs(cos * dy - sin * dx);
    const float beside = cos_half * aside - sin_half * ahead;  // the nearer side
    return cos_half < 0 || beside <= radius + 1e-3f;
  }
};

// Boxes relative to a viewer, each in its own frame.
struct Boxes {
  std::vector<float> cos, sin, length, width, along, across;

  void clear() {
    for (auto* values : {&cos, &sin, &length, &width, &along, &across}) values->clear();
  }
  void add(float dx, float dy, const float* direction, const float* half_size) {
    cos.push_back(direction[0]);
    sin.push_back(direction[1]);
    length.push_back(half_size[0]);
    width.push_back(half_size[1]);
    along.push_back(direction[0] * dx + direction[1] * dy);
    across.push_back(direction[0] * dy - direction[1] * dx);
  }
  size_t size() const { return cos.size(); }
};

float wrap(float angle) {
  angle = std::fmod(angle + kPi, 2 * kPi);
  return (angle < 0 ? angle + 2 * kPi : angle) - kPi;
}

float angle_between(float ax, float ay, float bx, float by) {
  return std::atan2(ax * by - ay * bx, ax * bx + ay * by);
}

// Where the part of a box that is in reach begins and ends, and its nearest corner, as
// angles to the direction of its centre.
struct Outline {
  float begin = kPi, end = -kPi, corner = 0;
  bool in_reach = false;

  Outline(float dx, float dy, const float* direction, const float* half_size,
          float reach) {
    const float cos = direction[0], sin = direction[1];
    const float length = half_size[0], width = half_size[1];
    constexpr float forward[] = {1, -1, -1, 1}, left[] = {1, 1, -1, -1};
    float x[5], y[5];
    float least = kInfinity;
    int nearest = 0;
    for (int i = 0; i < 4; ++i) {
      x[i] = dx + forward[i] * length * cos - left[i] * width * sin;
      y[i] = dy + forward[i] * length * sin + left[i] * width * cos;
      const float squared = x[i] * x[i] + y[i] * y[i];
      if (squared < least) least = squared, nearest = i;
    }
    x[4] = x[0], y[4] = y[0];
    for (int i = 0; i < 4; ++i) {
      const float along_x = x[i + 1] - x[i], along_y = y[i + 1] - y[i];
      const float raw = along_x * along_x + along_y * along_y;
      const float squared = raw > 0 ? raw : 1;
      const float middle = -(x[i] * along_x + y[i] * along_y) / squared;
      const float root =
          middle * middle - (x[i] * x[i] + y[i] * y[i] - reach * reach) / squared;
      const float half = std::sqrt(std::max(root, 0.0f));
      if (root < 0 || middle - half > 1 || middle + half < 0) continue;
      in_reach = true;
      for (const float end_share : {middle - half, middle + half}) {
        const float share = std::min(std::max(end_share, 0.0f), 1.0f);
        const float turn = angle_between(dx, dy, x[i] + share * along_x,
                                         y[i] + share * along_y);
        begin = std::min(begin, turn);
        end = std::max(end, turn);
      }
    }
    corner = angle_between(dx, dy, x[nearest], y[nearest]);
  }
};

// Returns the box that a ray meets first within the reach, or -1.
int first_hit(const Boxes& boxes, float ray_cos, float ray_sin, float reach,
              std::vector<float>& distances) {
  const size_t count = boxes.size();
  distances.resize(count);
  for (size_t i = 0; i < count; ++i) {
    float along = boxes.cos[i] * ray_cos + boxes.sin[i] * ray_sin;
    float across = boxes.cos[i] * ray_sin - boxes.sin[i] * ray_cos;
    along = std::abs(along) < 1e-9f ? 1e-9f : along;
    across = std::abs(across) < 1e-9f ? 1e-9f : across;
    const float middle_a = boxes.along[i] / along;
    const float middle_b = boxes.across[i] / across;
    const float reach_a = boxes.length[i] / std::abs(along);
    const float reach_b = boxes.width[i] / std::abs(across);
    const float near = std::max(middle_a - reach_a, middle_b - reach_b);
    const float far = std::min(middle_a + reach_a, middle_b + reach_b);
    const float distance = near > 0 ? near : far;
    distances[i] = (near <= far) & (far >= 0) ? distance : kInfinity;
  }
  int first = -1;
  float least = kInfinity;
  for (size_t i = 0; i < count; ++i) {
    if (distances[i] < least) least = distances[i], first = static_cast<int>(i);
  }
  return least <= reach ? first : -1;
}

ffi::Error visible_objects(ffi::ThreadPool pool, ffi::AnyBuffer number,
                           ffi::AnyBuffer cone, ffi::AnyBuffer xy,
                           ffi::AnyBuffer direction, ffi::AnyBuffer half_size,
                           ffi::AnyBuffer valid, ffi::Result<ffi::AnyBuffer> visible,
                           float beside) {
  const BatchShape batch(visible->dimensions(), 1);
  const Batched<const int32_t> numbers(number, batch);
  const Batched<const float> cones(cone, batch), places(xy, batch);
  const Batched<const float> directions(direction, batch), half_sizes(half_size, batch);
  const Batched<const bool> present(valid, batch);
  const Batched<bool> results(*visible, batch);
  for_each(pool, batch, 4, [&](const Place& place) {
    thread_local Boxes boxes;
    thread_local std::vector<float> rays, distances;
    thread_local std::vector<int64_t> own_number;
    boxes.clear();
    own_number.clear();
    const Cone cone(cones.at(place));
    const float half = cone.angle / 2;
    rays = {-half, half};
    bool* out = results.at(place);
    const int64_t count = results.length(0);
    for (int64_t i = 0; i < count; ++i) {
      out[i] = false;
      if (!present.at(place)[i] || i == *numbers.at(place)) continue;
      const float* of = directions.at(place) + 2 * i;
      const float* size = half_sizes.at(place) + 2 * i;
      const float dx = places.at(place)[2 * i] - cone.x;
      const float dy = places.at(place)[2 * i + 1] - cone.y;
      const float far = cone.distance + size[0] + size[1];
      if (!(dx * dx + dy * dy <= far * far)) continue;
      if (!cone.can_touch(dx, dy, size[0] + size[1])) continue;
      const Outline outline(dx, dy, of, size, cone.distance);
      if (!outline.in_reach) continue;
      boxes.add(dx, dy, of, size);
      own_number.push_back(i);
      const float centre = angle_between(cone.cos, cone.sin, dx, dy);
      const float begin = wrap(centre + outline.begin), end = wrap(centre + outline.end);
      const float corner = wrap(centre + outline.corner);
      for (const float ray :
           {begin - beside, begin + beside, corner, end - beside, end + beside}) {
        if (std::abs(ray) <= half) rays.push_back(ray);
      }
    }
    for (const float ray : rays) {
      const float yaw = cone.yaw + ray;
      const int hit =
          first_hit(boxes, std::cos(yaw), std::sin(yaw), cone.distance, distances);
      if (hit >= 0) out[own_number[hit]] = true;
    }
  });
  return ffi::Error::Success();
}

// Whether the segment from the viewer to an offset touches a box, by separating axes.
bool is_hidden(const Boxes& boxes, float dx, float dy) {
  int hits = 0;
  for (size_t i = 0; i < boxes.size(); ++i) {
    const float along = boxes.cos[i] * dx + boxes.sin[i] * dy;
    const float across = boxes.cos[i] * dy - boxes.sin[i] * dx;
    const float x = boxes.along[i], y = boxes.across[i];
    const float length = boxes.length[i], width = boxes.width[i];
    hits += (std::abs(2 * x - along) <= 2 * length + std::abs(along)) &
            (std::abs(2 * y - across) <= 2 * width + std::abs(across)) &
            (std::abs(along * y - across * x) <=
             length * std::abs(across) + width * std::abs(along));
  }
  return hits > 0;
}

// A set of map types: bit i stands for type i.
using MapTypes = uint32_t;

// Collects the points of a map in a cone. The point that closes a polygon is left out.
template <typename T>
void collect(const Map<T>& map, const Cone& cone, MapTypes left_out, MapTypes closed,
             std::vector<Candidate>& candidates) {
  candidates.clear();
  const auto add = [&](int32_t vertex) {
    const float dx = map.x(vertex) - cone.x, dy = map.y(vertex) - cone.y;
    const float squared = dx * dx + dy * dy;
    if (!(squared <= cone.distance * cone.distance)) return;
    if (!cone.is_between_sides(dx, dy, std::sqrt(squared))) return;
    candidates.push_back({key_of(squared), vertex});
  };
  const auto wants = [&](float x, float y, float radius) {
    return cone.can_touch(x - cone.x, y - cone.y, radius);
  };
  map.for_each_piece(cone.x, cone.y, cone.distance, wants, [&](int32_t piece) {
    const MapTypes type = MapTypes{1} << (map.tag[piece] & (kJoined - 1));
    const int32_t end = map.end(piece);
    const bool is_closing = end == piece && (type & closed);
    if ((type & left_out) || is_closing) return;
    add(piece);
    const bool is_last = end != piece && map.end(end) == end;
    if (is_last && !(type & closed)) add(end);
  });
}

template <typename T>
void look(ffi::ThreadPool pool, const ffi::RemainingArgs& args,
          const ffi::AnyBuffer& numbers, const ffi::AnyBuffer& counts,
          MapTypes left_out, MapTypes closed) {
  const auto operand = [&](size_t i) { return *args.get<ffi::AnyBuffer>(i); };
  const BatchShape batch(counts.dimensions(), 0);
  const Batched<const float> cones(operand(0), batch), places(operand(1), batch);
  const Batched<const float> directions(operand(2), batch);
  const Batched<const float> half_sizes(operand(3), batch);
  const Batched<const bool> hiding(operand(4), batch);
  const Maps<T> maps(args, 5, batch);
  const Batched<int32_t> found(numbers, batch), num_found(counts, batch);
  const int64_t most = found.length(0);
  for_each(pool, batch, 2, [&](const Place& place) {
    thread_local std::vector<Candidate> candidates, spare;
    thread_local Boxes boxes;
    const Cone cone(cones.at(place));
    const Map<T> map = maps.at(place);
    boxes.clear();
    for (int64_t i = 0; i < hiding.length(0); ++i) {
      if (!hiding.at(place)[i]) continue;
      const float* xy = places.at(place) + 2 * i;
      boxes.add(xy[0] - cone.x, xy[1] - cone.y, directions.at(place) + 2 * i,
                half_sizes.at(place) + 2 * i);
    }
    collect(map, cone, left_out, closed, candidates);
    sort(candidates, spare);
    int32_t* out = found.at(place);
    int64_t count = 0;
    for (size_t i = 0; i < candidates.size() && count < most; ++i) {
      const int32_t vertex = candidates[i].number;
      if (is_hidden(boxes, map.x(vertex) - cone.x, map.y(vertex) - cone.y)) continue;
      out[count++] = vertex;
    }
    std::fill(out + count, out + most, 0);
    *num_found.at(place) = static_cast<int32_t>(count);
  });
}

ffi::Error visible_points(ffi::ThreadPool pool, ffi::RemainingArgs args,
                          ffi::Result<ffi::AnyBuffer> numbers,
                          ffi::Result<ffi::AnyBuffer> count, int32_t left_out,
                          int32_t closed) {
  with_coordinates(args, 5, [&](auto coordinate) {
    look<decltype(coordinate)>(pool, args, *numbers, *count,
                               static_cast<MapTypes>(left_out),
                               static_cast<MapTypes>(closed));
  });
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(drivetrain_visible_objects, visible_objects,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>()
                                  .Attr<float>("beside"));

XLA_FFI_DEFINE_HANDLER_SYMBOL(drivetrain_visible_points, visible_points,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .RemainingArgs()
                                  .Ret<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>()
                                  .Attr<int32_t>("left_out")
                                  .Attr<int32_t>("closed"));

}  // namespace drivetrain
