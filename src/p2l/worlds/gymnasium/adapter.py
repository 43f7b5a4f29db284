"""robosuite's environments with gymnasium's interface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt


class RobosuiteEnv(gymnasium.Env[dict[str, Any], npt.NDArray[Any]]):
    """An environment of robosuite, unmodified, that is reset with a seed.

    Make it with `hard_reset=False`, so that a reset makes no other model, and `ignore_done=True`, so that no time limit
    ends a recovery. `info["success"]` is its own verdict.

    Args:
        environment: of `robosuite.make`.
        camera: whose picture `render` gives; it needs `has_offscreen_renderer=True`.
        size: of the picture, pixels (height, width).
        keys: parts of the observation to keep; all without any. What tells the same as another part, like the vector
            from the hand to an object beside the object's position, gives away an error that the other is to have.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 (gymnasium declares it for instances)
    render_mode = "rgb_array"

    def __init__(
        self,
        environment: Any,
        camera: str = "frontview",
        size: tuple[int, int] = (480, 640),
        keys: Sequence[str] = (),
    ) -> None:
        self.inner, self._camera, self._size, self._keys = environment, camera, size, tuple(keys)
        low, high = environment.action_spec
        self.action_space = gymnasium.spaces.Box(low, high, dtype=np.float64)
        parts = {
            key: gymnasium.spaces.Box(-np.inf, np.inf, np.shape(value))
            for key, value in self._arrays(environment._get_observations()).items()
        }
        self.observation_space = gymnasium.spaces.Dict(parts)  # type: ignore[arg-type]

    @property
    def sim(self) -> Any:
        """Of robosuite."""
        return self.inner.sim

    @property
    def dt(self) -> float:
        """Seconds of a control step."""
        return float(self.inner.control_timestep)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Objects and robot are placed by `seed`."""
        super().reset(seed=seed, options=options)
        if seed is not None:
            self.inner.rng.bit_generator.state = np.random.default_rng(seed).bit_generator.state
        return self._arrays(self.inner.reset()), {"success": False}

    def step(self, action: npt.NDArray[Any]) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """One control step."""
        observation, reward, done, info = self.inner.step(action)
        return (
            self._arrays(observation),
            float(reward),
            False,
            bool(done),
            {**info, "success": self.inner._check_success()},
        )

    def render(self) -> Any:
        """[H, W, 3]; the environment need not have been made with an offscreen renderer."""
        height, width = self._size
        if self.inner.sim._render_context_offscreen is None:
            from robosuite.utils.binding_utils import MjRenderContextOffscreen

            self.inner.sim.add_render_context(MjRenderContextOffscreen(self.inner.sim, device_id=-1))
        return self.inner.sim.render(camera_name=self._camera, height=height, width=width)[::-1]

    def close(self) -> None:
        """Of robosuite."""
        self.inner.close()

    def _arrays(self, observation: Any) -> dict[str, Any]:
        return {key: np.asarray(observation[key]) for key in self._keys or observation}
