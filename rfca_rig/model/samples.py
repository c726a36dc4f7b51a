"""Output between the two ends of a step: angles and speeds by cubic Hermite interpolation, forces by the laws. Symbols as in `state`."""

from rfca_rig.model.compiled import jit_inline, jit_internal
from rfca_rig.model.forces import measure
from rfca_rig.model.state import Chain, Laws, Samples, State, Work


@jit_inline
def interpolate(state: State, end: int, h: float, x: float, work: Work) -> None:
    """Interpolates q, w, a at the share x of a step of length h from `state` to stage `end` into `work`: order 4 for q and w, 3 for a."""
    q1, w1, a1 = work.stage_q[end], work.stage_w[end], work.stage_a[end]
    for i in range(state.q.size):
        rise, m0, m1 = q1[i] - state.q[i], h * state.w[i], h * w1[i]
        work.q[i] = state.q[i] + x * (m0 + x * (3.0 * rise - 2.0 * m0 - m1 + x * (m0 + m1 - 2.0 * rise)))
        rise, m0, m1 = w1[i] - state.w[i], h * state.a[i], h * a1[i]
        c2, c3 = 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise
        work.w[i] = state.w[i] + x * (m0 + x * (c2 + x * c3))
        work.a[i] = (m0 + x * (2.0 * c2 + x * 3.0 * c3)) / h


@jit_internal
def fill_samples(chain: Chain, laws: Laws | None, state: State, t: float, t_new: float, first: int, work: Work, out: Samples) -> int:
    """Fills the samples inside (t, t_new], from `state` to the last stage. Returns the next sample's index."""
    h, end = t_new - t, work.stage_q.shape[0] - 1
    while first < out.t.size and out.t[first] <= t_new:
        elapsed = out.t[first] - t
        interpolate(state, end, h, elapsed / h, work)
        # Forces are not interpolated: contact and friction vary within a step more than a cubic can follow.
        measure(chain, laws, state, elapsed, work.q, work.w, work.a, work, work.force)
        for i in range(state.q.size):
            out.q[first, i], out.w[first, i] = work.q[i], work.w[i]
        for i in range(state.anchor.size):
            out.contact[first, 0, i], out.contact[first, 1, i] = work.contact[0, i], work.contact[1, i]
        for i in range(3):
            out.force[first, i] = work.force[i]
        first += 1
    return first
