// Room in an array of `capacity` for item `index` of `total`: all of them where they fit, an even selection where they
// do not.
const NO_ROOM: u32 = 0xffffffffu;

// floor(capacity * 2^32 / total) for capacity < total, by long division.
fn keep_ratio(total: u32, capacity: u32) -> u32 {
  var remainder = capacity;
  var ratio = 0u;
  for (var i = 0u; i < 32u; i++) {
    let carry = remainder >> 31u;
    remainder <<= 1u;
    ratio <<= 1u;
    if carry != 0u || remainder >= total {
      remainder -= total;
      ratio |= 1u;
    }
  }
  return ratio;
}

// NO_ROOM for items left out.
fn slot_for(index: u32, total: u32, capacity: u32) -> u32 {
  if total <= capacity {
    return index;
  }
  let ratio = keep_ratio(total, capacity);
  let room = multiply_high(index, ratio);
  let taken = index > 0u && multiply_high(index - 1u, ratio) == room;
  return select(room, NO_ROOM, taken);
}

// The room of an item, or of the one before it that got one.
fn nearest_room(index: u32, total: u32, capacity: u32) -> u32 {
  if total <= capacity {
    return index;
  }
  return multiply_high(index, keep_ratio(total, capacity));
}

// How many slots are taken: the last one may not be.
fn slots_taken(total: u32, capacity: u32) -> u32 {
  return select(nearest_room(max(total, 1u) - 1u, total, capacity) + 1u, 0u, total == 0u || capacity == 0u);
}

// The item that has a given room.
fn item_of(room: u32, total: u32, capacity: u32) -> u32 {
  if total <= capacity {
    return room;
  }
  let ratio = keep_ratio(total, capacity);
  var low = 0u;
  var high = total - 1u;
  while low < high {
    let middle = low + (high - low) / 2u;
    if multiply_high(middle, ratio) >= room {
      high = middle;
    } else {
      low = middle + 1u;
    }
  }
  return low;
}
