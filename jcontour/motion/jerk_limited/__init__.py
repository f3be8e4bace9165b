"""Time-optimal motion along a path under limits of speed, acceleration and jerk on every axis.

With p(s) the path, s(t) the motion, and ' the derivative with respect to s, the axes move by

    speed         p' v                               |.| <= V_i, and |p'| v <= feed
    acceleration  p'' v^2 + p' a                     |.| <= A_i
    jerk          p''' v^3 + 3 p'' v a + p' j        |.| <= J_i

from rest to rest, with a stop wherever p' or p'' jumps. TOPP (Bobrow; Verscheure et al., IEEE TAC
54, 2009; TOPP-RA) ends at the acceleration, where the problem is convex in v^2. With the jerk it
is not. It is solved here as a warp of time: any slow motion sigma(tau) along the path is taken, and
u(tau) = (d tau / dt)^2 is looked for. In u the limits of speed and acceleration are linear, and
that of the jerk is

    | P''' u + 3/2 P'' u' + 1/2 P' u'' | <= J / sqrt(u),       P(tau) = p(sigma(tau)),

whose right side is convex: an interior point method keeps all limits at every step, since a tangent
of it lies below it. The motion that is found is the sigma of the next pass, on a finer mesh.
"""
