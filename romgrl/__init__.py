"""romgrl: humanoids that learn to walk and run from a reduced-order model, with no human demonstration."""

from gymnasium.envs.registration import register

__version__ = "0.1.0"

register(
    id="romgrl/SpringLeg-v0",
    entry_point="romgrl.rom.env:SpringLegEnv",
    vector_entry_point="romgrl.rom.vector_env:SpringLegVectorEnv",
)
register(
    id="romgrl/VariableLeg-v0",
    entry_point="romgrl.rom.env:VariableLegEnv",
    vector_entry_point="romgrl.rom.vector_env:VariableLegVectorEnv",
)
register(
    id="romgrl/PlanarHumanoid-v0",
    entry_point="romgrl.humanoid.env:PlanarHumanoidEnv",
    vector_entry_point="romgrl.humanoid.vector_env:PlanarHumanoidVectorEnv",
)
