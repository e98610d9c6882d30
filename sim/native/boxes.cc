// Finds the boxes that overlap a box or lie on a swept path; see `box_search.py`.

#include <cmath>
#include <limits>

#include "batch.h"

namespace drivetrain {
namespace {

// A box seen from above: half its sides, and the unit vector along its length.
struct Box {
  float x, y, cos, sin, length, width;
};

// As `geometry.boxes_overlap`: apart along no side's direction.
inline bool overlap(const Box& a, const Box& b) {
  const float cos = std::abs(a.cos * b.cos + a.sin * b.sin);
  const float sin = std::abs(a.cos * b.sin - a.sin * b.cos);
  const float x = b.x - a.x, y = b.y - a.y;
  const float along_a = std::abs(a.cos * x + a.sin * y);
  const float across_a = std::abs(a.cos * y - a.sin * x);
  const float along_b = std::abs(b.cos * x + b.sin * y);
  const float across_b = std::abs(b.cos * y - b.sin * x);
  return (along_a < a.length + b.length * cos + b.width * sin) &
         (across_a < a.width + b.length * sin + b.width * cos) &
         (along_b < b.length + a.length * cos + a.width * sin) &
         (across_b < b.width + a.length * sin + a.width * cos);
}

// Whether boxes are near enough to overlap, whatever their directions.
inline bool is_near(const Box& a, const Box& b) {
  const float x = b.x - a.x, y = b.y - a.y;
  const float reach = a.length + a.width + b.length + b.width;
  return x * x + y * y <= reach * reach;
}

// The operands of both kernels that describe the boxes of a scene.
struct Scene {
  Batched<const float> xy, direction, half_size;
  Batched<const bool> valid;

  int64_t size() const { return valid.length(0); }
};

struct Boxes {
  const float *xy, *direction, *half_size;
  const bool* valid;

  Boxes(const Scene& scene, const Place& place)
      : xy(scene.xy.at(place)),
        direction(scene.direction.at(place)),
        half_size(scene.half_size.at(place)),
        valid(scene.valid.at(place)) {}

  Box operator[](int64_t i) const {
    return {xy[2 * i],           xy[2 * i + 1],       direction[2 * i],
            direction[2 * i + 1], half_size[2 * i], half_size[2 * i + 1]};
  }
};

ffi::Error overlaps(ffi::ThreadPool pool, ffi::AnyBuffer number, ffi::AnyBuffer xy,
                    ffi::AnyBuffer direction, ffi::AnyBuffer half_size,
                    ffi::AnyBuffer valid, ffi::Result<ffi::AnyBuffer> hit) {
  const BatchShape batch(hit->dimensions(), 0);
  const Batched<const int32_t> numbers(number, batch);
  const Scene scene{{xy, batch}, {direction, batch}, {half_size, batch}, {valid, batch}};
  const Batched<bool> hits(*hit, batch);
  const int64_t num_boxes = scene.size();
  for_each(pool, batch, 64, [&](const Place& place) {
    const Boxes boxes(scene, place);
    const int64_t own = clamped(*numbers.at(place), num_boxes);
    const Box box = boxes[own];
    bool& hit = *hits.at(place);
    hit = false;
    if (!boxes.valid[own]) return;
    constexpr int kAtOnce = 32;
    for (int64_t first = 0; first < num_boxes && !hit; first += kAtOnce) {
      const int count = static_cast<int>(std::min<int64_t>(kAtOnce, num_boxes - first));
      uint32_t near = 0;
      for (int i = 0; i < count; ++i) {
        near |= uint32_t{is_near(box, boxes[first + i])} << i;
      }
      for (; near; near &= near - 1) {
        const int64_t i = first + __builtin_ctz(near);
        hit |= i != own && boxes.valid[i] && overlap(box, boxes[i]);
      }
    }
  });
  return ffi::Error::Success();
}

struct Contact {
  float distance = std::numeric_limits<float>::infinity();
  int32_t box = 0, chord = 0;
};

// The first box that a rectangle of the given half width meets on chords of a way.
Contact first_contact(const Boxes& boxes, int64_t num_boxes, int64_t own,
                      const float* places, int64_t num_chords, float half_width,
                      float chord_length) {
  Contact first;
  const float reach = num_chords * chord_length;
  for (int64_t i = 0; i < num_boxes; ++i) {
    if (!boxes.valid[i] || i == own) continue;
    const Box other = boxes[i];
    const float radius = other.length + other.width + half_width;
    const float apart_x = other.x - places[0], apart_y = other.y - places[1];
    const float far = reach + radius;
    if (!(apart_x * apart_x + apart_y * apart_y < far * far)) continue;
    for (int64_t chord = 0; chord < num_chords; ++chord) {
      const float* start = places + 2 * chord;
      const float x = start[2] - start[0], y = start[3] - start[1];
      const float length = std::sqrt(x * x + y * y);
      const float scale = 1 / std::max(length, 1e-6f);
      // A chord without length points along +x, as arctan2(0, 0) does.
      const float cos = length > 0 ? x * scale : 1, sin = length > 0 ? y * scale : 0;
      const Box swept{start[0] + x / 2, start[1] + y / 2, cos, sin, length / 2,
                      half_width};
      if (!overlap(swept, other)) continue;
      const float to_centre = cos * (other.x - start[0]) + sin * (other.y - start[1]);
      const float half_extent =
          other.length * std::abs(cos * other.cos + sin * other.sin) +
          other.width * std::abs(cos * other.sin - sin * other.cos);
      const float ahead = std::max(to_centre - half_extent, 0.0f);
      const float distance = chord * chord_length + ahead;
      if (distance < first.distance) {
        first = {distance, static_cast<int32_t>(i), static_cast<int32_t>(chord)};
      }
    }
  }
  return first;
}

ffi::Error leaders(ffi::ThreadPool pool, ffi::AnyBuffer number, ffi::AnyBuffer active,
                   ffi::AnyBuffer place, ffi::AnyBuffer xy, ffi::AnyBuffer direction,
                   ffi::AnyBuffer half_size, ffi::AnyBuffer valid,
                   ffi::Result<ffi::AnyBuffer> contact, ffi::Result<ffi::AnyBuffer> box,
                   ffi::Result<ffi::AnyBuffer> chord, float chord_length) {
  const BatchShape batch(contact->dimensions(), 0);
  const Batched<const int32_t> numbers(number, batch);
  const Batched<const bool> is_active(active, batch);
  const Batched<const float> places(place, batch);
  const Scene scene{{xy, batch}, {direction, batch}, {half_size, batch}, {valid, batch}};
  const Batched<float> contacts(*contact, batch);
  const Batched<int32_t> found(*box, batch), chords(*chord, batch);
  const int64_t num_boxes = scene.size(), num_chords = places.length(0) - 1;
  for_each(pool, batch, 8, [&](const Place& at) {
    const Boxes boxes(scene, at);
    const int64_t own = clamped(*numbers.at(at), num_boxes);
    Contact first;
    if (*is_active.at(at)) {
      first = first_contact(boxes, num_boxes, own, places.at(at), num_chords,
                            boxes[own].width, chord_length);
    }
    *contacts.at(at) = first.distance;
    *found.at(at) = first.box;
    *chords.at(at) = first.chord;
  });
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(drivetrain_overlaps, overlaps,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>());

XLA_FFI_DEFINE_HANDLER_SYMBOL(drivetrain_leaders, leaders,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Arg<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>()
                                  .Attr<float>("chord_length"));

}  // namespace drivetrain
