// Placeholder until the rasterizer lands.
namespace isoskin {}
