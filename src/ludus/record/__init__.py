"""Films of games, and datasets of their steps.

::

    dataset       complete episodes as a Minari dataset; `ludus record --dataset`
    recording     what to film, with whom, how long; `ludus record`
    game_film     a Godot game in a window
    gym_film      a Gymnasium environment that renders to arrays
    shot          which frames are taken, and until when
    camera        takes the frames of a Godot game; recorder.gd sends them
    screen        a screen where there is none
    film          encodes frames into a file
    palette       the colours of a GIF
    film_kinds    .mp4, .webm, .gif

Each imports only those below it.
"""

from ludus.record.film import Film
from ludus.record.recording import RecordConfig, Recorded, record

__all__ = ["Film", "RecordConfig", "Recorded", "record"]
