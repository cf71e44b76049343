"""What ``--help`` says after the list of flags: commands to copy, and what comes of them."""

EPILOG = """
A first run:
  dogsplat train photos/ -o run --downscale 2 --steps 7000 --max-primitives 60000
  dogsplat info run/point_cloud.ply
  dogsplat render run/point_cloud.ply -o view.png --data photos/ --camera 0001

photos/ is a COLMAP folder (images/ and sparse/0), a folder with transforms.json (instant-ngp, nerfstudio) or
transforms_train.json (NeRF synthetic), or a Mitsuba scene XML; for plain images or a video poses are found
first (dogsplat poses). run/report.html tells how it went.
Exit codes: 0 done, 2 wrong use or bad input (one line says what to do); 1 where dogsplat check found a defect,
or a run of dogsplat compare failed; 130 stopped by Ctrl-C, 143 by SIGTERM.
"""

TRAIN_EXAMPLES = """
Examples:
  dogsplat train photos/ -o run                        the full schedule, a tenth of the primitives
  dogsplat train photos/ -o run --steps 7000 --downscale 2 --max-primitives 60000
                                                       minutes instead of hours, and a bounded size
  dogsplat train photos/ -o run --target 20000         a model of exactly so many primitives
  dogsplat train photos/ -o run --target 2MB --format spz
                                                       a file of at most so many bytes
  dogsplat train photos/ -o run --preset 3dgs          without pruning and DoG: the published baseline
  dogsplat train lego/ -o run --background white       images with alpha over white (as auto does)
  dogsplat train lego/ -o run --background random      another colour at each step: no splats hide in it
  dogsplat train photos/ -o run --masks masks/ --exposure
                                                       people painted out; automatic exposure taken out
  dogsplat train photos/ -o run --data-on-disk         more photographs than fit into memory
  dogsplat train pictures/ -o run --downscale 4        images without cameras: their poses first, in run/posed
  dogsplat train walk.mp4 -o run --downscale 4         a video: its frames and poses first

Afterwards RUN holds point_cloud.ply (the model), report.html (open it in a browser), metrics.json,
history.jsonl, config.json, and test/ with a render, the photograph and an error map per test view.
Ctrl-C saves a checkpoint and stops; the same command with --resume goes on there, also after a crash.
"""
PRUNE_EXAMPLES = """
Examples:
  dogsplat prune model.ply photos/ -o run                      a tenth of its primitives
  dogsplat prune model.ply photos/ -o run --target 20000 --steps 3500 --downscale 2
  dogsplat prune model.ply photos/ -o run --target 2MB --format spz
                                                               a file of at most so many bytes
  dogsplat prune model.ply photos/ -o run --preset released    as the authors' code does it

The model may come from any trainer of 3D Gaussians. The schedule begins with its first prune, without
densification; --steps counts from there (default: what the preset's schedule has left). RUN is filled as by
dogsplat train; its history names every decision to prune or to refine, with the reason.
"""
ABLATE_EXAMPLES = """
Examples:
  dogsplat ablate photos/ -o ablation --steps 7000 --downscale 2 --max-primitives 40000
  dogsplat ablate photos/ -o ablation --steps 7000 --downscale 2 --max-primitives 40000 --seeds 3
                                                       one more seed in the same table
3dgs is the baseline at 100 %; v1, v2, v3 and full add a part of the paper's method each; released is the
authors' code; ours is the preset ours, ours_gaussian the same without DoG. All of a seed go on from one
start, at the end of densification, and end with the same number of steps. DIR is filled as by dogsplat
compare, of which these are methods: DIR/comparison.html has the table, and each variant is a run folder
under DIR/DATA/seed_N/. What is complete is not repeated.
"""
COMPARE_EXAMPLES = """
Examples:
  dogsplat compare photos/ -o compared --steps 7000 --downscale 2 --max-primitives 40000
  dogsplat compare fox/ fern/ lego/ -o compared --seeds 0 1 2 --only 3dgs speedy_splat ours
                                                       three data sets, three seeds, three methods
  dogsplat compare photos/ -o compared --only published equal
                                                       all, also with our window and step sizes
  dogsplat compare photos/ -o compared --only paper ours --more-targets 0.05 0.2
                                                       tables of equal bytes and equal time, too
  dogsplat compare fox/ fern/ -o compared --workers 2  two runs at a time, on this machine
  dogsplat compare fox/ fern/ -o compared --cluster tcp://10.0.0.7:8786
                                                       on the workers of a Dask cluster (docs/compare.md)
All methods of a seed have one renderer, one densified start, one number of steps and of primitives; 3dgs is
the baseline at 100 %. DIR/comparison.html has the tables, plots and pictures, comparison.csv and .tex the
numbers; they are rewritten as runs finish, and each run is a run folder under DIR/DATA/seed_N/. What is
complete is not repeated. A run that fails is named, and stops no other. --workers and --cluster need the
extra mi_dogsplat[cluster].
"""
RENDER_EXAMPLES = """
Examples:
  dogsplat render run/point_cloud.ply -o view.png                     a view that frames the model
  dogsplat render run/point_cloud.ply -o view.png --data photos/      the first test view of the data
  dogsplat render run/point_cloud.ply -o view.exr --data photos/ --camera 0001
                                                                      a view by its name
  dogsplat render run/point_cloud.ply -o view.png --camera camera.json
  dogsplat render run/point_cloud.ply -o view.exr --aovs depth,normal,index
                                                                      channels depth.Z, normal.X, ... index.I
  dogsplat render scene.xml -o view.exr                               first sensor of a Mitsuba scene

A camera file holds {"w2c": 4x4 world to camera (x right, y down, z forward), "fx": pixels, "fy", "cx",
"cy", "width", "height"}; fy, cx and cy may be left out. A .png shows colours over the background; an .exr
holds linear colour, premultiplied with alpha, and depth, or what --aovs lists: depth, median_depth, normal
(in world space), index (of the primitive that contributes most, or -1), count (of contributions), and
dog_share (of the contributions).
"""
EVAL_EXAMPLES = """
Examples:
  dogsplat eval run/point_cloud.ply photos/ --downscale 2
  dogsplat eval run/point_cloud.ply photos/ --downscale 2 -o measured/   also writes pictures and metrics.json
  dogsplat eval run/point_cloud.ply photos/ --masks masks/ --color-correct
                                                       white pixels; and PSNR after colour correction

Use the --downscale that the model was trained with, else the numbers say little about it.
"""
CAPTURE_EXAMPLES = """
Examples:
  dogsplat capture scene.xml -o data                     48 views from a hemisphere, 8 more for testing
  dogsplat capture scene.xml -o data --alpha --spp 256   only what stands there, with little noise
  dogsplat capture scene.xml -o data --path orbit --elevations 20 20 --views 60
                                                         one turn at a height
  dogsplat capture scene.xml -o data --path sensors      each perspective sensor of the scene
  dogsplat capture scene.xml -o data --path cameras.json --depth exr
Then: dogsplat train data/ -o run

The scene's own integrator renders. DATA holds images/, points.ply and transforms.json (nerfstudio's layout,
OpenGL poses). cameras.json is a list of camera files (see dogsplat render --help), each with a "name" if you
like. Depth is along the view axis in world units, 0 where nothing is; with npy give nerfstudio
--depth-unit-scale-factor 1. A capture that was stopped goes on where it was with the same command; --points
alone may differ then.
"""
POSES_EXAMPLES = """
Examples:
  dogsplat poses pictures/ -o posed                    photographs of one scene, from a phone or a camera
  dogsplat poses walk.mp4 -o filmed                    a video: sharp frames, as many as its motion asks for
  dogsplat poses pictures/ -o straight --undistort     for programs that know no lenses
  dogsplat poses pictures/ -o strong --lens OPENCV     a lens that bends lines much
  dogsplat poses pictures/ -o metres --scale IMG_1.jpg IMG_9.jpg 2.5
                                                       in metres: these two were taken 2.5 m apart
Then: dogsplat train posed/ -o run

DATA becomes a COLMAP folder: images/ (upright, else as they are) and sparse/0, which every trainer reads.
Up is -y, and the origin is in the middle of the points. Photographs of one device, size and focal length
share a camera; EXIF gives its focal length. What is black in masks/ is not matched. The end says how many
images have a pose, and what to do if they are few. Stopped, the same command goes on where it was. dogsplat
train does all this by itself when its DATA are plain images or a video. Needs the extra mi_dogsplat[poses].
"""
CHECK_EXAMPLES = """
Examples:
  dogsplat check -o checked                              scenes made here, and stability cases
  dogsplat check run/point_cloud.ply -o checked --data photos/ --camera 0001
                                                         and a model, from a view of its data
  dogsplat check -o checked --only stability             a part alone: in a minute
  dogsplat check -o checked --only training --runs run_a run_b
                                                         training error against run time of two runs

work-precision: error of image and gradients against float64, and run time, over cutoffs, tile bounds, shared
exponentials, primitives kept, SH degree, DoG; leave the machine alone meanwhile. stability: inputs that break
naive splatting code. training: error against wall-clock time of --runs.
DIR/check.html shows it all, DIR/check.json holds it. A stability case that is wrong is printed; exit code 1.
"""
EXPORT_EXAMPLES = """
Examples:
  dogsplat export run/point_cloud.ply -o model.spz                    Niantic, Babylon, Spark; small
  dogsplat export run/point_cloud.ply -o model.sog                    PlayCanvas, SuperSplat; small
  dogsplat export run/point_cloud.ply -o model.sog --small --data photos/ --downscale 2
                                                                      a third of that, refined for it
  dogsplat export run/point_cloud.ply -o model.compressed.ply         the same; a quarter of a PLY
  dogsplat export run/point_cloud.ply -o model.glb                    glTF (KHR_gaussian_splatting); lossless
  dogsplat export run/point_cloud.ply -o plain.ply --data photos/ --downscale 2
                                                                      any 3DGS viewer; measured on photographs
  dogsplat export run/point_cloud.ply -o small.compressed.ply --dog keep
                                                                      with DoG, in five bytes each
  dogsplat export run/point_cloud.ply -o model.html --data photos/ --views 0
                                                                      a page with a viewer, to send around

MODEL may have any of these formats. Those that know no negative lobes get the Gaussian nearest to a DoG
primitive, or its primary (--dog drop); --dog keep is for .ply and .compressed.ply. The baked model is refined
on the photographs of --data, or on renders, 10 to 100 ms a step on a CPU (--refine 0: not at all). The file is
read back, and the loss of each stage is printed. .spz, .glb and .gltf have y up, the others the axes of the
model. A page (.html, 0.8 MB and the model) needs a browser and no network, and opens with the first photograph
of the data.
"""
FILM_EXAMPLES = """
Examples:
  dogsplat film run/ -o film.mp4                                  what suits the data of the run
  dogsplat film run/point_cloud.ply -o film.mp4 --seconds 6 --elevation 35 --size 1920 1080
                                                                  one turn around the model
  dogsplat film run/ -o film.mp4 --path cameras --smoothing 4     the way of the photographer, smoothed
  dogsplat film run/point_cloud.ply -o film.mp4 --path keys.json --shutter 0.5
                                                                  through key frames, with motion blur
  dogsplat film run/point_cloud.ply -o frames/                    numbered pictures, frames/0000.png and on
  dogsplat film run/point_cloud.ply -o frames_exr/%04d.exr        linear colour with alpha, for compositing

Key frames: {"keys": [{"time": 0, "position": [3, 0, 1], "look_at": [0, 0, 0], "fov": 40}, ...],
"loop": false, "up": [0, 0, 1]}, or a list of camera files (docs/film.md). A film that is stopped leaves no
file; of numbered pictures the whole ones stay, and the same command goes on after them.
"""
SIMPLIFY_EXAMPLES = """
Examples:
  dogsplat simplify model.ply -o small.ply --target 10%       a tenth of its primitives, in minutes
  dogsplat simplify model.ply -o small.ply --target 20 --steps 0
                                                              so many, merged alone: in seconds
  dogsplat simplify model.ply -o small.ply --target 5% --dog  with Differences of Gaussians

For models without photographs, of any program; with photographs dogsplat prune knows better what matters.
Cameras are placed around the model, and where there is room inside. They say how much of each primitive is
seen, and the merged model is fitted to what they see of the old one. PSNR is measured from other places. The
pictures have a grey background, so that nothing hides in it; --background black or white fits to that alone.
"""
CLEAN_EXAMPLES = """
Examples:
  dogsplat clean model.ply -o lean.ply                       what no picture shows leaves: all keep their bits
  dogsplat clean model.ply -o object.ply --sphere 0 0 0 1.5 --connected 1 --preview clean.png
                                                             an object alone; and a picture to look at first
  dogsplat clean model.ply -o lean.ply --data photos/ --seen --floaters
                                                             what the photographs do not bear out

Without flags: primitives of an opacity below 1/255, DoG without effect, and SH bands that are zero. What the
flags take out is counted, each primitive for the first reason that it has. --seen leaves every training view
as it is. --floaters goes by the surfaces that the views show (docs/clean.md): look at the PSNR before and
after, which --data adds.
"""
VIEW_EXAMPLES = """
Examples:
  dogsplat view run/point_cloud.ply                     open the address that it prints in a browser
  dogsplat view run/                                    a run while it trains: follows its checkpoint
  dogsplat view run/point_cloud.ply --data photos/ --downscale 2
                                                        with the error at the nearest photograph
  dogsplat view run/ --host 0.0.0.0 --port 9000         also for other machines; there is no password

Every picture is rendered here: small while the camera moves, full when it rests. The panel switches DoG off,
shows DoG or Gaussians alone, differences and errors, and sets resolution, SH degree and background.
"""
INFO_EXAMPLES = """
Examples:
  dogsplat info run/point_cloud.ply   counts, ranges, and primitives that are broken or wasted
  dogsplat info run/                  settings and result of a run
  dogsplat info photos/               views, split, points, and whether the cameras see the points
  dogsplat info --features scene.xml  what its kernels need, at what cost, and what is left out of them
"""
