"""The harness's own data sets and incompletenesses, registered as a third party's would be."""

from pcdbench.plugins import Register, hookimpl


@hookimpl
def register_datasets(register: Register) -> None:
    register("indoor", "pcdbench.datasets.synthetic:Indoor", "fifty generated indoor environments, scanned", path=False)
    register("s3dis", "pcdbench.datasets.s3dis:S3DIS", "Stanford's rooms as released: text files, six areas")
    register(
        "rgbd", "pcdbench.datasets.rgbd:Rgbd", "posed colour and depth images, fused (7-Scenes, TUM, ScanNet, RTAB-Map)"
    )
    register("clouds", "pcdbench.datasets.clouds:Clouds", "a scan, or a folder of scans, on disk")


@hookimpl
def register_incompletenesses(register: Register) -> None:
    register("holes", "pcdbench.incompletenesses.holes:Holes", "patches of 3 % of the points (published)")
    register(
        "short_scan",
        "pcdbench.incompletenesses.short_scan:ShortScan",
        "what a short hand-held walk leaves unseen",
    )
    register(
        "real_pair",
        "pcdbench.incompletenesses.real_pair:RealPair",
        "another, shorter scan of the same place (clouds, rgbd)",
    )
