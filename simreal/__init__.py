"""The sim-to-real gap: where simulator and logs disagree, which effect causes it, and how far it
shrinks once the effect is in the twin.

Reading order, each room resting on those before it:

1. `ins.errors`: the list of errors. An effect is parameters with units and usual sizes, what a
   recording must hold to show it, and the trace of one unit of each coefficient. One implementation
   is the signature of a diagnosis and what a simulation adds.
2. `evidence`: a run becomes whitened rows, the same for the log and for the trace of an effect
   (`run_view`, then `whitened` with `parked` and `rolling`).
3. `declared`: what a twin file lists already, and the free functions that compete with the names.
4. `inference`: which effects explain the rows. `diagnosis.diagnose` is the spine; `bank`, `scoring`
   and `attribute` choose, `addback` measures the shrink on held-out data, `locate` says where.
5. `twin`: effects put into a simulated run, and the twin file with what was found.
6. `plan`: which recordings would tell rival effects apart, by the same whitening.
7. `report`: documents and pages of `recal diagnose` and `recal plan`; they compute nothing.

A user's own effect needs `ins.errors.own` alone (examples/own_effect.py).
"""
