"""Pictures of clouds and of the meshes rebuilt from them, drawn without a display or a graphics card."""
