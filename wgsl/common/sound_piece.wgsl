// Which pieces rays can meet. Needs math and surfel.

#import ray

fn is_sound(piece: Piece) -> bool {
  let largest = max(abs(piece.a), max(abs(piece.b), abs(piece.c)));
  return is_finite3(piece.a) && is_finite3(piece.b) && is_finite3(piece.c) && max_component(largest) <= FAR;
}
